"""It works without a real-time kernel: what this machine lacks, what that costs, and what to do about it.

`rtstack check --left ADDRESS --right ADDRESS` also holds the arms, and judges the link for ten seconds.
"""

import json
import subprocess

done = subprocess.run(["rtstack", "check", "--json"], capture_output=True, text=True, check=False)
findings = json.loads(done.stdout)["findings"]
for finding in findings:
    if finding["verdict"] != "pass":
        print(f"{finding['name']}: {finding['value']}")
        print(f"    costs: {finding['cost'] or '-'}")
        print(f"    do:    {finding['advice'] or '-'}")
timer = next(finding for finding in findings if finding["name"] == "timer")
print(f"{len(findings)} findings; the timer is {timer['value']}")
