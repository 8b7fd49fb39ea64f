"""What somebody at the command line can put right. Each kind of it is defined beside what raises it."""


class TrainerError(Exception):
    """The message names the thing and what to do; a command prints it as one line and ends with status 2."""
