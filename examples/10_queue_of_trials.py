"""A program that works through a queue: record, accept the recording, queue two trials, read results, fetch logs.

rtstack up                                       # in a terminal of its own: prints an address
rtstack token create --name queue --scope operate
python 10_queue_of_trials.py http://127.0.0.1:8080 TOKEN
"""

import sys
import time
from contextlib import closing
from importlib import import_module
from pathlib import Path

example = import_module("09_talk_to_the_console")  # beside this file: a program that has control

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python 10_queue_of_trials.py ADDRESS TOKEN")
    with closing(example.Console(*sys.argv[1:])) as console:
        console.post("take")
        console.post("arm")
        job = console.run("demonstration", object="rice_box")
        print("demonstration:", job["state"], job["reason"] or "")

        recording = console.logs()[0]["id"]
        extraction = console.get(f"recordings/{recording}")["extraction"]
        print("problem of the recording:", extraction["problem"] or "none")
        console.post(f"recordings/{recording}", name="a grab for the queue", verdict="accepted")

        console.post("take")  # reading the recording took its time, without a sign of life
        console.post("arm")
        trial = {"reference": recording, "object": "rice_box", "displacement_mm": 15.0}
        console.post("queue", trial=trial, repetitions=2)  # with seeds 0 and 1
        queue = console.post("queue/start")
        while queue["running"]:
            time.sleep(example.BEAT_S)
            console.post("beat")  # who is gone is no operator: the queue would pause
            queue = console.get("queue")
        print("queue:", queue["reason"])

        outcomes = {row["id"]: row["outcome"] for row in console.logs()}
        for entry in queue["entries"]:
            print("seed", entry["trial"]["seed"], entry["state"], outcomes.get(entry["log"], entry["reason"]))
            if entry["log"] is not None:
                console.download(entry["log"], Path(f"queued-{entry['trial']['seed']}.mcap"))
        console.post("release")
