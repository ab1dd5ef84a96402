"""From what a machine is to what has to change, in order. What is as it should be is not in the plan."""

import ipaddress
import re
from dataclasses import dataclass, field

from deploy.host.changes import Change, Command, File, Knob
from deploy.host.machine import HostSetupError, Machine, cpu_list, cpu_text

ACCOUNT = "rtstack"  # the user and the group of the stack
# of the threads of the arms' interrupts on a PREEMPT_RT kernel, by default 50 there: above the loop's 70 and what runs
# beside it at 60 (hal/base/realtime.py), which they feed, below a simulated robot's 80
IRQ_PRIORITY = 75
# above the loop's 70 and a simulated robot's 80 (hal/base/realtime.py), below the kernel's own threads at 99
PRIORITY = 90
MTU = 1500  # what the arm's control box speaks: larger frames do not arrive
LIMITS = "/etc/security/limits.d/90-rtstack.conf"
GRUB = "/etc/default/grub.d/90-rtstack.cfg"
BOOT = "/usr/local/sbin/rtstack-host-boot"
UNIT = "/etc/systemd/system/rtstack-host.service"
CPUS = "/etc/systemd/system/rtstack-robot.service.d/cpus.conf"
_KERNEL = {"debian": "linux-image-rt-amd64"}  # what the distribution calls it
_OURS = "# Written by `rtstack host-setup`; `rtstack host-setup --undo` takes it back.\n"
GENERIC_COST = (
    "kernel: generic. Where a driver does not let go, a tick is late by milliseconds: the robot bridges single lost "
    "packets, and stops after 20 in a row (communication_constraints_violation). Good for the simulated robot and for "
    "commissioning; for experiments: --kernel rt"
)


@dataclass(frozen=True, slots=True)
class Interface:
    """A network interface for the arms, with this PC's own address on it, such as 172.16.0.1/24."""

    name: str
    address: str

    @classmethod
    def parse(cls, text: str) -> "Interface":
        """Read NAME=ADDRESS/PREFIX. Raises HostSetupError."""
        name, _, address = text.partition("=")
        try:
            if not re.fullmatch(r"[A-Za-z0-9_.-]{1,15}", name) or "/" not in address:
                raise ValueError
            ipaddress.IPv4Interface(address)
        except ValueError:
            raise HostSetupError(f"--nic {text}: write it as enp3s0=172.16.0.1/24") from None
        return cls(name, address)


@dataclass(frozen=True, slots=True)
class Wishes:
    """What is asked for. users: who may run the stack by hand; isolate: how many CPUs are kept for the loop, None: one,
    where there are four or more; kernel: rt or generic; units: the units' texts by name, to be installed."""

    users: tuple[str, ...] = ()
    interfaces: tuple[Interface, ...] = ()
    isolate: int | None = None
    kernel: str = "generic"
    units: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SetupPlan:
    """changes: in the order in which they are applied. notes: what a person has to know or to do."""

    changes: tuple[Change, ...]
    notes: tuple[str, ...]


def make_plan(machine: Machine, wishes: Wishes) -> SetupPlan:
    """Return what has to change. Raises HostSetupError where a wish cannot be met."""
    cpus = cpu_list(machine.text("/sys/devices/system/cpu/online"))
    realtime = machine.text("/sys/kernel/realtime") == "1"
    count = (1 if len(cpus) >= 4 else 0) if wishes.isolate is None else wishes.isolate
    if count < 0 or count > len(cpus) - 2:
        raise HostSetupError(f"--isolate {count}: this machine has {len(cpus)} CPUs, and needs two for everything else")
    notes: list[str] = []
    isolated = _with_siblings(machine, cpus, cpus[len(cpus) - count :], notes)
    kept = [cpu for cpu in cpus if cpu not in isolated]
    changes = [
        *_account(machine, wishes),
        *([] if realtime else _kernel(machine, wishes, notes)),
        *_isolation(machine, kept, isolated, wishes.kernel == "generic" and not realtime, notes),
        *_interfaces(machine, wishes, notes),
        *_boot(machine, wishes, kept[-1], isolated),
        *_units(machine, wishes, cpus, isolated),
    ]
    if machine.run is None and any(isinstance(change, Command) for change in changes):
        notes.append(f"{machine.root} is not the running machine: files are written, commands are left to you")
    return SetupPlan(tuple(changes), tuple(notes))


def _with_siblings(machine: Machine, cpus: list[int], isolated: list[int], notes: list[str]) -> list[int]:
    """Return the CPUs to isolate and what shares a core with them: a busy hyperthread halves the loop's speed."""
    more = set(isolated)
    for cpu in isolated:
        path = f"/sys/devices/system/cpu/cpu{cpu}/topology/thread_siblings_list"
        more |= set(cpu_list(machine.text(path) or str(cpu))) & set(cpus)
    if more > set(isolated) and len(cpus) - len(more) < 2:
        notes.append(
            f"CPU {cpu_text(isolated)} shares its core with another one that has to do everything else: "
            "switch hyperthreading off in the firmware"
        )
        return isolated
    return sorted(more)


def _account(machine: Machine, wishes: Wishes) -> list[Change]:
    changes: list[Change] = []
    if ACCOUNT not in machine.users:
        create = ("useradd", "--system", "--user-group", "--home-dir", "/var/lib/rtstack", "--no-create-home",
                  "--shell", "/usr/sbin/nologin", ACCOUNT)  # fmt: skip
        changes.append(Command(create, ("userdel", ACCOUNT), "the stack runs as a user without any privilege"))
    for user in wishes.users:
        if user not in machine.users:
            raise HostSetupError(f"--user {user}: there is no such user on this machine")
        if user not in machine.groups.get(ACCOUNT, []):
            add, delete = (("gpasswd", f"--{verb}", user, ACCOUNT) for verb in ("add", "delete"))
            changes.append(Command(add, delete, f"{user} may run the stack at a terminal, after the next login"))
    limits = f"{_OURS}@{ACCOUNT} - rtprio {PRIORITY}\n@{ACCOUNT} - memlock unlimited\n"
    return changes + _file(machine, LIMITS, limits, "SCHED_FIFO and mlockall for the group: late ticks without them")


def _kernel(machine: Machine, wishes: Wishes, notes: list[str]) -> list[Change]:
    if wishes.kernel == "generic":
        notes.append(GENERIC_COST)
        return []
    found = re.search(r"^ID=\"?([a-z]+)", machine.text("/etc/os-release"), re.MULTILINE)
    package = _KERNEL.get(found[1] if found else "")
    if found and found[1] == "ubuntu":
        notes.append(
            "kernel: Ubuntu's real-time kernel comes with a Pro subscription, which is yours to attach: "
            "`sudo pro attach`, `sudo pro enable realtime-kernel`, then restart"
        )
        return []
    if package is None:
        notes.append("kernel: Debian's and Ubuntu's are known here; install your distribution's PREEMPT_RT kernel")
        return []
    if machine.names(f"/var/lib/dpkg/info/{package}.list"):
        notes.append("kernel: PREEMPT_RT is installed and does not run: restart, and choose it in the boot menu")
        return []
    notes.append("kernel: PREEMPT_RT runs after a restart; it costs some throughput, and drivers outside Debian's")
    return [Command(("apt-get", "install", "--yes", package), ("apt-get", "remove", "--yes", package),
                    "PREEMPT_RT: nothing but hardware keeps the loop waiting for long")]  # fmt: skip


def _isolation(machine: Machine, kept: list[int], isolated: list[int], generic: bool, notes: list[str]) -> list[Change]:
    options = ["preempt=full"] if generic else []
    if isolated:
        mine = cpu_text(isolated)
        options += [f"isolcpus=managed_irq,domain,{mine}", f"nohz_full={mine}", f"rcu_nocbs={mine}"]
        options.append(f"irqaffinity={cpu_text(kept)}")
    else:
        notes.append("CPU isolation: none; on a busy machine the loop shares its CPU")
    if not options:
        return []
    if not machine.at("/etc/default/grub").exists():
        notes.append(f"no GRUB here: add to the kernel's command line: {' '.join(options)}")
        return []
    line = f'{_OURS}GRUB_CMDLINE_LINUX_DEFAULT="$GRUB_CMDLINE_LINUX_DEFAULT {" ".join(options)}"\n'
    why = f"CPU {cpu_text(isolated)} is for the loop alone" if isolated else "a tick waits less for the kernel"
    written = _file(machine, GRUB, line, f"{why}; everything else has {cpu_text(kept)}; from the next start on")
    if written:
        notes.append("restart the machine for the kernel's command line")
    return _announced(written, ("update-grub",), "the boot menu", "the file is")


def _interfaces(machine: Machine, wishes: Wishes, notes: list[str]) -> list[Change]:
    changes: list[Change] = []
    by_manager = machine.at("/etc/NetworkManager").is_dir()
    for nic in wishes.interfaces:
        if not machine.at(f"/sys/class/net/{nic.name}").exists():
            there = ", ".join(name.rpartition("/")[2] for name in machine.names("/sys/class/net/*"))
            raise HostSetupError(f"--nic {nic.name}: there is no such interface; there are {there or 'none'}")
        if re.search(rf"\b{re.escape(nic.name)}\b", machine.text("/etc/network/interfaces")):
            notes.append(f"/etc/network/interfaces names {nic.name} too: take it out there")
        if by_manager:
            path = f"/etc/NetworkManager/system-connections/rtstack-{nic.name}.nmconnection"
            reload, mode = ("nmcli", "connection", "reload"), 0o600  # NetworkManager ignores what others can read
            text = (
                f"{_OURS}[connection]\nid=rtstack-{nic.name}\ntype=ethernet\ninterface-name={nic.name}\n\n"
                f"[ethernet]\nmtu={MTU}\n\n[ipv4]\nmethod=manual\naddress1={nic.address}\nnever-default=true\n\n"
                "[ipv6]\nmethod=disabled\n"
            )
        else:
            path = f"/etc/systemd/network/10-rtstack-{nic.name}.network"
            reload, mode = ("networkctl", "reload"), 0o644
            text = (
                f"{_OURS}[Match]\nName={nic.name}\n\n[Link]\nMTUBytes={MTU}\n\n"
                f"[Network]\nAddress={nic.address}\nDHCP=no\nLinkLocalAddressing=no\n"
            )
        written = _file(machine, path, text, f"{nic.name}: a fixed address, no route, MTU {MTU}", mode)
        changes += _announced(written, reload, "the network", "the file is")
        if machine.run is not None:
            former = re.search(r"^rx-usecs:\s*(\d+)", machine.run(("ethtool", "--show-coalesce", nic.name)), re.M)
            if former and former[1] != "0":
                base = ("ethtool", "--coalesce", nic.name, "rx-usecs")
                changes.append(Command((*base, "0"), (*base, former[1]),
                                       "a packet is told about at once: more interrupts, less delay"))  # fmt: skip
    return changes


def _boot(machine: Machine, wishes: Wishes, irq_cpu: int, isolated: list[int]) -> list[Change]:
    """Governor, sleep and interrupts: now by knobs, and after each start by a unit."""
    why, governors = (
        "no CPU has to speed up first; costs power",
        "/sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
    )
    knobs = [(path, "performance", why) for path in machine.names(governors)]
    lines = ["for governor in /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor; do",
             '    [ -w "$governor" ] && echo performance > "$governor"', "done"]  # fmt: skip
    for cpu in sorted({irq_cpu, *isolated}):
        # the kernel's word for no latency at all: sysfs-devices-power in its documentation. Per CPU, and for no longer
        # than the machine runs; /dev/cpu_dma_latency would keep all CPUs awake, and only while a program holds it open
        path = f"/sys/devices/system/cpu/cpu{cpu}/power/pm_qos_resume_latency_us"
        knobs.append((path, "n/a", f"CPU {cpu} does not sleep deeper than it can wake at once; costs power"))
        lines.append(f"[ -w {path} ] && echo n/a > {path}")
    for nic in wishes.interfaces:
        # not the loop's CPU: it looks for packets without sleeping, and would keep their interrupts waiting
        irqs = machine.names(f"/sys/class/net/{nic.name}/device/msi_irqs/*")
        paths = [f"/proc/irq/{irq.rpartition('/')[2]}/smp_affinity_list" for irq in irqs]
        knobs += [(path, str(irq_cpu), f"interrupts of {nic.name} beside the loop's CPU") for path in paths]
        lines += [f"for irq in /sys/class/net/{nic.name}/device/msi_irqs/*; do",
                  f'    echo {irq_cpu} > "/proc/irq/${{irq##*/}}/smp_affinity_list"', "done",
                  f"ethtool --coalesce {nic.name} rx-usecs 0",
                  # only a PREEMPT_RT kernel has these threads; their names are cut after 15 letters
                  f"for irq in /sys/class/net/{nic.name}/device/msi_irqs/*; do",
                  '    for task in $(grep --files-with-matches "^irq/${irq##*/}-" /proc/[0-9]*/comm 2>/dev/null); do',
                  "        task=${task%/comm}",
                  f"        chrt --fifo --pid {IRQ_PRIORITY} ${{task##*/}}", "    done", "done"]  # fmt: skip
    there = [knob for knob in knobs if machine.at(knob[0]).exists()]
    changes: list[Change] = [Knob(*knob) for knob in there if machine.text(knob[0]) != knob[1]]
    script = "#!/bin/sh\n" + _OURS + "\n".join([*lines, "exit 0"]) + "\n"
    unit = (
        f"{_OURS}[Unit]\nDescription=CPU governor, sleep and network interrupts for rtstack\nAfter=network.target\n\n"
        f"[Service]\nType=oneshot\nExecStart={BOOT}\n\n[Install]\nWantedBy=multi-user.target\n"
    )
    written = _file(machine, BOOT, script, "the same after each start", 0o755)
    written += _file(machine, UNIT, unit, "runs it")
    changes += _announced(written, ("systemctl", "daemon-reload"), "systemd", "the unit is")
    if not machine.names(f"/etc/systemd/system/multi-user.target.wants/{(name := 'rtstack-host.service')}"):
        changes.append(Command(("systemctl", "enable", name), ("systemctl", "disable", name), "at each start"))
    if wishes.interfaces and machine.names("/etc/systemd/system/*.wants/irqbalance.service"):
        switch = ("systemctl", "disable", "--now", "irqbalance"), ("systemctl", "enable", "--now", "irqbalance")
        changes.append(Command(*switch, "it would move the interrupts away again"))
    return changes


def _units(machine: Machine, wishes: Wishes, cpus: list[int], isolated: list[int]) -> list[Change]:
    written: list[Change] = []
    for name, text in wishes.units.items():
        written += _file(machine, f"/etc/systemd/system/{name}", text, "a unit of the stack; not started by this")
    if isolated and (wishes.units or machine.at(CPUS).exists()):
        text = f"{_OURS}[Service]\nCPUAffinity={cpu_text(cpus)}\n"
        why = "only threads that select an isolated CPU run on it: the loop takes the last"
        written += _file(machine, CPUS, text, why)
    return _announced(written, ("systemctl", "daemon-reload"), "systemd", "they are")


def _file(machine: Machine, path: str, content: str, why: str, mode: int = 0o644) -> list[Change]:
    place = machine.at(path)
    if place.is_file() and place.read_text(errors="replace") == content and place.stat().st_mode & 0o7777 == mode:
        return []
    return [File(path, content, why, mode)]


def _announced(written: list[Change], command: tuple[str, ...], reader: str, what: str) -> list[Change]:
    """Return files, if any, with the command for their reader: after they are written, and after they are gone."""
    if not written:
        return []
    return [Command((), command, f"{reader}, once {what} gone"), *written, Command(command, (), reader)]
