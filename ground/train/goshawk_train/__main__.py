"""`python -m goshawk_train`.

Two process settings decide the speed of training on a CPU, and both are read before Python's first line: how threads
wait (spinning ones starve each other beside other work: measured 2-4 x) and huge pages for the tensors that come and
go each step (measured 1.3 x). So training starts itself again once with them.
"""

import os
import signal
import sys

TRAINING = ("train", "ablations")
SETTINGS = {"OMP_WAIT_POLICY": "PASSIVE", "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"}

if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in TRAINING and any(name not in os.environ for name in SETTINGS):
        environment = {**SETTINGS, **os.environ}
        os.execve(sys.executable, [sys.executable, "-m", "goshawk_train", *sys.argv[1:]], environment)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends like Ctrl-C, a simulator that it runs with it
    from goshawk_train.cli import main

    status = main()
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        # One of several workers: threads of the process group may still let go of tensors, which aborts a process whose
        # interpreter is on its way out (pytorch/pytorch#179291). All files are closed by now.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    raise SystemExit(status)
