"""A page that never guesses: it shows what the robot process says, and since when. A program reads the same.

rtstack up                                       # in a terminal of its own: prints an address
rtstack token create --name example --scope view
python 27_what_a_page_knows.py http://127.0.0.1:8080 TOKEN
"""

import sys

import httpx

if len(sys.argv) != 3:
    sys.exit("usage: python 27_what_a_page_knows.py ADDRESS TOKEN")
headers = {"authorization": f"Bearer {sys.argv[2]}"}
with httpx.Client(base_url=sys.argv[1], headers=headers, timeout=30.0, trust_env=False) as console:
    answer = console.get("/api/status")
    if answer.is_error:  # the robot process does not answer: unknown, and not what it was
        sys.exit(f"unknown: {answer.json()['error']}")
    status = answer.json()
    print(f"phase {status['phase']} for {status['since_s']:.1f} s, reason: {status['reason'] or 'none'}")
    print(f"in control: {status['holder'] or 'no operator'}; arms: {'simulated' if status['simulated'] else 'REAL'}")
