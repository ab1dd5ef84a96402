"""What stops the arms when the operator goes: a program that has control falls silent while they move.

rtstack up                                       # in a terminal of its own: prints an address
rtstack token create --name example --scope operate
python 28_operator_goes.py http://127.0.0.1:8080 TOKEN
"""

import sys
import time
from contextlib import closing
from importlib import import_module

example = import_module("09_talk_to_the_console")  # beside this file: a program that has control

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python 28_operator_goes.py ADDRESS TOKEN")
    with closing(example.Console(*sys.argv[1:])) as console:
        console.post("take")
        console.post("arm")
        status = console.post("jobs/demonstration", object="rice_box")
        while status["job"]["state"] in example.ACTIVE:  # to look is no sign of life; POST /api/beat would be
            time.sleep(example.BEAT_S / 5)
            status = console.get("status")
        print(f"{status['phase']}: {status['reason']}")
        console.post("take")  # an operator who comes back takes control, and recovers; nothing moves
        print("recovered:", console.post("recover")["phase"])
        console.post("release")
