"""The host's set-up on made-up root trees: shown, applied, interrupted, applied again, taken back to the byte."""

import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from deploy.host.changes import Command
from deploy.host.journal import Journal
from deploy.host.machine import HostSetupError, Machine
from deploy.host.plan import IRQ_PRIORITY, Interface, Wishes, make_plan
from hal.base.realtime import _BESIDE, PRIORITY
from rtstack.cli.host_setup import apply_changes

COMMAND = Path(sys.executable).with_name("rtstack")
WISHES = Wishes(users=("anna",), interfaces=(Interface("enp3s0", "172.16.0.1/24"),), kernel="rt")
FILES = {
    "etc/os-release": "ID=debian\n",
    "etc/passwd": "root:x:0:0::/root:/bin/sh\nanna:x:1000:1000::/home/anna:/bin/sh\n",
    "etc/group": "root:x:0:\nanna:x:1000:\n",
    "etc/default/grub": "GRUB_CMDLINE_LINUX_DEFAULT=quiet\n",
    "etc/security/limits.d/90-rtstack.conf": "# an older one, by hand\n",
    "etc/systemd/system/multi-user.target.wants/irqbalance.service": "",
    "sys/devices/system/cpu/online": "0-3\n",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "powersave\n",
    "sys/devices/system/cpu/cpu3/cpufreq/scaling_governor": "powersave\n",
    "sys/class/net/enp3s0/address": "02:00:00:00:00:01\n",
    "sys/class/net/enp3s0/device/msi_irqs/41": "msi\n",
    "proc/irq/41/smp_affinity_list": "0-3\n",
}


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A PC with Debian, four CPUs and a second network interface."""
    tree = tmp_path / "root"
    for name, text in FILES.items():
        path = tree / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tree / "etc/security/limits.d/90-rtstack.conf").chmod(0o600)
    return tree


def photograph(root: Path) -> dict[str, tuple[int, bytes | None]]:
    """Return kind, mode and content of everything below a folder."""
    found = {}
    for path in sorted(root.rglob("*")):
        content = path.read_bytes() if path.is_file() else None
        found[str(path.relative_to(root))] = (stat.S_IMODE(path.stat().st_mode), content)
    return found


class Programs:
    """What the commands of the set-up do to a made-up tree: each keeps a file of what it was asked last."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.said: list[str] = []

    def __call__(self, command: tuple[str, ...]) -> str:
        self.said.append(" ".join(command))
        return "rx-usecs: 3\n" if "--show-coalesce" in command else ""


def applied(root: Path) -> Programs:
    """Apply the wishes, with the commands that they need."""
    programs = Programs(root)
    machine = Machine(root, programs)
    list(Journal(machine).apply(make_plan(machine, WISHES).changes))
    return programs


def test_a_dry_run_shows_every_change_and_writes_nothing(root, command_line):
    before = photograph(root)
    wishes = ("--user", "anna", "--nic", "enp3s0=172.16.0.1/24", "--units")
    done = command_line("host-setup", "--root", root, *wishes, "--dry-run")
    assert done.returncode == 0, done.stderr
    assert photograph(root) == before
    for line in (
        "-# an older one, by hand", "+@rtstack - rtprio 90", "isolcpus=managed_irq,domain,3", "preempt=full",
        "$ gpasswd --add anna rtstack", "--undo: gpasswd --delete anna rtstack", "powersave -> performance",
        "+Address=172.16.0.1/24", "smp_affinity_list: 0-3 -> 2",
        "+++ /etc/systemd/system/rtstack-robot.service", "+CPUAffinity=0-3",
        "none of them made", "note: kernel: generic",
    ):  # fmt: skip
        assert line in done.stdout


def test_undo_puts_back_every_byte(root):
    before = photograph(root)
    programs = applied(root)
    assert photograph(root) != before
    assert (root / "proc/irq/41/smp_affinity_list").read_text() == "2\n"
    assert "apt-get install --yes linux-image-rt-amd64" in programs.said
    assert "ethtool --coalesce enp3s0 rx-usecs 0" in programs.said
    undone = Programs(root)
    list(Journal(Machine(root, undone)).undo())
    assert photograph(root) == before
    # in the opposite order, and the boot menu is made anew only when its file is gone
    assert undone.said[-2:] == ["gpasswd --delete anna rtstack", "userdel rtstack"]
    assert undone.said.count("update-grub") == programs.said.count("update-grub") == 1
    assert "ethtool --coalesce enp3s0 rx-usecs 3" in undone.said


def test_what_was_applied_is_not_applied_again(root):
    applied(root)
    once = photograph(root)
    again = make_plan(Machine(root), WISHES)  # asks no program, and changes no account in this tree
    assert [change for change in again.changes if not isinstance(change, Command)] == []
    list(Journal(Machine(root)).apply(again.changes))
    assert photograph(root) == once


def test_other_wishes_later_are_undone_together(root):
    before = photograph(root)
    applied(root)
    machine = Machine(root)
    list(Journal(machine).apply(make_plan(machine, Wishes(isolate=2)).changes))
    assert "nohz_full=2-3" in (root / "etc/default/grub.d/90-rtstack.cfg").read_text()
    list(Journal(machine).undo())
    assert photograph(root) == before


@pytest.mark.parametrize("after", range(12))
def test_an_interruption_anywhere_can_be_undone(root, after):
    before = photograph(root)
    machine = Machine(root)
    journal = Journal(machine)
    steps = journal.apply(make_plan(machine, WISHES).changes)
    for _ in range(after):
        next(steps, None)
    steps.close()
    entries = journal.entries
    if entries:  # what a power cut leaves: a change that was noted and not made, and half a line
        noted = dict(entries[-1])
        if noted["kind"] == "file" and noted["former"] is None:
            (root / noted["path"].lstrip("/")).unlink()
        with (root / "var/lib/rtstack-host-setup/journal").open("a") as file:
            file.write('{"kind": "file", "pa')
    half = journal.undo()
    next(half, None)
    half.close()  # undoing is interrupted too
    list(journal.undo())
    assert photograph(root) == before


def test_ctrl_c_is_one_line_and_can_be_undone(root, capsys):
    before = photograph(root)

    class Interrupted(Programs):
        def __call__(self, command):
            if command == ("update-grub",):
                signal.raise_signal(signal.SIGINT)
            return super().__call__(command)

    machine = Machine(root, Interrupted(root))
    with pytest.raises(typer.Exit) as ended:
        apply_changes(machine, make_plan(machine, WISHES).changes)
    assert ended.value.exit_code == 1
    assert capsys.readouterr().err.startswith("rtstack: interrupted after ")
    governor = root / "sys/devices/system/cpu/cpu3/cpufreq/scaling_governor"
    assert governor.read_text() == "powersave\n"  # its turn comes later
    assert photograph(root) != before
    done = subprocess.run([str(COMMAND), "host-setup", "--root", str(root), "--undo"], capture_output=True, timeout=60)
    assert done.returncode == 0
    assert photograph(root) == before


def test_what_somebody_has_changed_since_is_not_overwritten(root):
    applied(root)
    file = root / "etc/security/limits.d/90-rtstack.conf"
    file.write_text("@rtstack - rtprio 50\n")
    now = photograph(root)
    with pytest.raises(HostSetupError, match=r"limits\.d/90-rtstack\.conf was changed since"):
        list(Journal(Machine(root)).undo())
    assert photograph(root) == now
    list(Journal(Machine(root)).undo(force=True))
    assert file.read_text() == "# an older one, by hand\n"


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--nic", "enp9s0=172.16.0.1/24"], "there are enp3s0"),
        (["--nic", "enp3s0=172.16.0.300/24"], "enp3s0=172.16.0.1/24"),
        (["--user", "ben"], "no such user"),
        (["--isolate", "3"], "has 4 CPUs"),
        (["--kernel", "windows"], "is not one of 'rt', 'generic'"),
    ],
)
def test_a_wish_that_cannot_be_met_is_one_line(root, command_line, arguments, word):
    before = photograph(root)
    done = command_line("host-setup", "--root", root, *arguments)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert word in done.stderr
    assert photograph(root) == before


def test_without_the_right_to_write_it_says_so(root, unprivileged):
    if not unprivileged:
        root.chmod(0o555)
    command = [*unprivileged, sys.executable, "-m", "rtstack", "host-setup", "--root", str(root)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd="/")
    root.chmod(0o755)
    assert done.returncode == 2, done.stderr
    assert "Permission denied; run it as root" in done.stderr
    assert done.stderr.count("\n") == 1


def plan_text(root: Path, wishes: Wishes = WISHES) -> tuple[str, list[str]]:
    """Return everything that the plan would write, and its notes."""
    plan = make_plan(Machine(root), wishes)
    return "\n".join(str(change) for change in plan.changes), list(plan.notes)


def test_what_shares_a_core_with_the_loop_is_isolated_too(root):
    (root / "sys/devices/system/cpu/online").write_text("0-7\n")
    for cpu in range(8):
        topology = root / f"sys/devices/system/cpu/cpu{cpu}/topology"
        topology.mkdir(parents=True)
        (topology / "thread_siblings_list").write_text(f"{cpu % 4},{cpu % 4 + 4}\n")
    text, _ = plan_text(root)
    assert "isolcpus=managed_irq,domain,3,7 " in text
    assert "irqaffinity=0-2,4-6" in text


def test_a_core_that_everything_else_needs_is_not_taken_from_it(root):
    topology = root / "sys/devices/system/cpu/cpu3/topology"
    topology.mkdir(parents=True)
    (topology / "thread_siblings_list").write_text("1-3\n")
    text, notes = plan_text(root)
    assert "isolcpus=managed_irq,domain,3 " in text
    assert any("switch hyperthreading off in the firmware" in note for note in notes)


def test_the_loop_s_cpu_stays_awake_and_the_interrupts_threads_come_before_what_runs_beside_the_loop(root, tmp_path):
    sleep = root / "sys/devices/system/cpu/cpu3/power/pm_qos_resume_latency_us"
    sleep.parent.mkdir(parents=True)
    sleep.write_text("0\n")
    applied(root)
    assert sleep.read_text().strip() == "n/a"
    script = (root / "usr/local/sbin/rtstack-host-boot").read_text()
    assert _BESIDE < PRIORITY < IRQ_PRIORITY < 80
    # the script itself, on made-up tasks and interrupts
    said = tmp_path / "said"
    for name, body in (("chrt", f'echo "$@" >> {said}'), ("ethtool", "exit 0")):
        program = tmp_path / "bin" / name
        program.parent.mkdir(exist_ok=True)
        program.write_text(f"#!/bin/sh\n{body}\n")
        program.chmod(0o755)
    for number, comm in ((88, "irq/41-enp3s0"), (89, "irq/410-other"), (90, "python")):
        task = root / f"proc/{number}/comm"
        task.parent.mkdir(parents=True)
        task.write_text(comm + "\n")
    here = script.replace("/sys/", f"{root}/sys/").replace("/proc/", f"{root}/proc/")
    subprocess.run(["sh", "-c", here], env={"PATH": f"{tmp_path / 'bin'}:/usr/bin:/bin"}, check=True)
    assert said.read_text() == f"--fifo --pid {IRQ_PRIORITY} 88\n"


def test_ubuntu_s_kernel_is_named_and_left_to_its_owner(root):
    (root / "etc/os-release").write_text("ID=ubuntu\n")
    text, notes = plan_text(root)
    assert "apt-get" not in text
    assert any("pro enable realtime-kernel" in note for note in notes)
