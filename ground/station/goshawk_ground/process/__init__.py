"""What a command is as a process of its system."""
