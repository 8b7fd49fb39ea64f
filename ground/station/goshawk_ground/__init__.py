"""The operator's side: the Zenoh client, the `goshawk` command line, and the demo."""
