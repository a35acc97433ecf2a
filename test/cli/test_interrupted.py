"""An interrupted command ends, whatever its threads do."""

import subprocess
import sys

PROGRAM = """
import sys, threading
from occ_recon_ros.cli import app, main

def interrupted():
    def command(*_, **__):
        threading.Thread(target=threading.Event().wait).start()  # as one that is stuck
        print("begun")
        raise KeyboardInterrupt
    return command

app._commands = interrupted
sys.exit(main())
"""


def test_a_thread_that_never_ends_does_not_keep_an_interrupted_command():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "replay"], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "begun\n", "error: interrupted\n")
