"""Set-ups that are wrong, each in one way: the cell's file, the plant behind its wire, the command, or the person.

The 24 rows of a trial of rtstack 1.0.0 as a lab would have tried it are METAL, the others OWN. What is written to the
cell's file is signed afterwards, as by a lab that has commissioned the cell with the mistake in it.
"""

import contextlib
import re
import resource
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import psutil

from tests.support.fci.raw import RawClient
from tests.support.metal.metal import AtTerminal, Metal
from tests.support.metal.page import PageOperator

TRIAL, TEACH, PLAY = "trial", "teach", "play"
METAL, OWN = "METAL", "own"
# postures of the left arm, the right one's mirrored: the pads 100 mm above home, and in the table
HIGH = (-0.293789, -0.182868, 0.247605, -2.593584, -1.57879, 1.637408, 0.846764)
LOW = (-0.279291, 0.36991, 0.242204, -2.498108, -1.646022, 1.502396, 1.282473)
HOME = (-0.301958, 0.089107, 0.267142, -2.576334, -1.613419, 1.566484, 1.090987)
FAR = (-0.301958, 0.089107, 0.267142, -2.576334, -1.613419, 1.566484, -0.509013)
_MIRROR = (-1, 1, -1, 1, -1, 1, -1)
Act = Callable[[Metal, AtTerminal], object]


@dataclass(frozen=True, slots=True)
class Setup:
    """A wrong set-up.

    Args:
        name: What is wrong.
        origin: METAL or OWN.
        file: Replacements in the cell's file: a pattern of a line, and what stands there instead.
        scene: The same in the plant's scene.
        plant_file: The same in a file of a cell that the plant is given; none where it is empty.
        profile: Appended to the ideal profile of the plant.
        faults: A script of faults of the plant.
        options: Of the robot, beside the object.
        robot: Python that the robot begins with.
        command: The motion that is asked for.
        more: Options of the command, `{metal...}` filled in.
        prelude: Python that the command begins with.
        kind: The cell as the command names it, `{metal...}` filled in.
        types: What the person types as the cell's name.
        before: What is done once the robot serves.
        act: What happens meanwhile, in a thread of its own.
        desk: Desk is served, and the file has it: "started" by a person, "off" as it was switched on, or with the
            serial numbers "exchanged" in the file; empty: none.
        page: Not a command at a terminal, but an operator at the page leads by hand; what happens then, which returns
            why the arms stopped, or raises.
        let_go_ms: The person lets go of the key after so many milliseconds of motion; None: never.
        hang_up: The terminal is closed instead.
        real_address: The robot is served at an address that is not loopback, in a network namespace.
        harmless: Why a success is right; empty: a success is a wrong motion.
    """

    name: str
    origin: str = OWN
    file: tuple[tuple[str, str], ...] = ()
    scene: tuple[tuple[str, str], ...] = ()
    plant_file: tuple[tuple[str, str], ...] = ()
    profile: str = ""
    faults: str = ""
    options: tuple[str, ...] = ()
    robot: str = ""
    command: str = TRIAL
    more: tuple[str, ...] = ()
    prelude: str = ""
    kind: str = "{metal.kind}"
    cell_file: bool = True
    types: str = "grab"
    before: Callable[[Metal], object] | None = None
    act: Act | None = None
    desk: str = ""
    page: Callable[[PageOperator], str] | None = None
    let_go_ms: int | None = None
    hang_up: bool = False
    real_address: bool = False
    harmless: str = ""


def both(posture: tuple[float, ...]) -> tuple[list[float], list[float]]:
    """Return a posture of the left arm and its mirror image, of the right one."""
    return list(posture), [sign * q for sign, q in zip(_MIRROR, posture, strict=True)]


def begins(posture: tuple[float, ...]) -> tuple[tuple[str, str], ...]:
    """Return the changes of a scene or a file whose arms have another home."""
    left, right = both(posture)
    return ((r"home = \[-0\.30.*", f"home = {left}"), (r"home = \[0\.30.*", f"home = {right}"))


def _bases(change: Callable[[np.ndarray], np.ndarray]) -> tuple[tuple[str, str], ...]:
    return tuple(
        (re.escape(f"base_position = [-0.4, {y}, 0.0]"), f"base_position = {change(np.array([-0.4, y, 0.0])).tolist()}")
        for y in (0.5, -0.5)
    )


def _fault(kind: str, at_s: float | None, **more: object) -> str:
    when = {} if at_s is None else {"at_s": at_s}
    keys = {"kind": kind, **when, **more}
    lines = [f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value}" for key, value in keys.items()]
    return "[[fault]]\n" + "\n".join(lines) + "\n"


# what happens meanwhile


def _after(milliseconds: int, do: Act) -> Act:
    """Do something once the arms have been moved for so long."""

    def act(metal: Metal, running: AtTerminal) -> None:
        seen = metal.seen
        while seen["moving_ticks"] < milliseconds and running.process.poll() is None:
            time.sleep(0.002)
        if running.process.poll() is None:
            do(metal, running)

    return act


def _suspend(seconds: float, number: int = signal.SIGSTOP) -> Act:
    def act(_metal: Metal, running: AtTerminal) -> None:
        running.process.send_signal(number)
        time.sleep(seconds)
        running.process.send_signal(signal.SIGCONT)

    return act


def _kill_robot(metal: Metal, _running: AtTerminal) -> None:
    assert metal.robot is not None
    metal.robot.kill()


def _second_client(metal: Metal, _running: AtTerminal) -> None:
    with metal.command(["teach", str(metal.folder / "second.mcap"), "--cell", metal.kind, "--cell-file",
                        str(metal.cell_file)]) as second:  # fmt: skip
        status = second.carry_out(second.terminal.hold)
        (metal.folder / "second.txt").write_text(f"{status} {second.terminal.said}")


def _full_disk(size: int) -> Act:
    """The log's file must not grow beyond so many bytes."""

    def act(_metal: Metal, running: AtTerminal) -> None:
        program = psutil.Process(running.process.pid)
        with contextlib.suppress(psutil.NoSuchProcess):
            while running.process.poll() is None:
                for child in program.children():
                    if any("log" in word for word in child.cmdline()):
                        resource.prlimit(child.pid, resource.RLIMIT_FSIZE, (size, size))
                        return
                time.sleep(0.002)

    return act


def _other_client(metal: Metal) -> None:
    """Somebody else's program is connected to the right box, for as long as this one runs."""
    client = RawClient(metal.right)
    client.connect()
    metal.others.append(client)


def _console_frozen(operator: PageOperator) -> str:
    with operator.console_frozen():
        time.sleep(3.0)
    return operator.ended()


def _second_operator(operator: PageOperator) -> str:
    refusals = [operator.second(path) for path in ("take", "arm", "jobs/teleoperation")]
    if any(" 409 " not in refusal and " 422 " not in refusal for refusal in refusals):
        return f"done: a second operator was let in: {refusals}"
    operator.second("stop")
    return operator.ended()


def _page_gone(operator: PageOperator) -> str:
    operator.let_go()
    return operator.ended().replace("done", "stopped")  # a job by hand is done when its page has gone


_NO_FIFO = """
import ctypes, resource
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
_libc, _header = ctypes.CDLL(None), (ctypes.c_uint32 * 2)(0x20080522, 0)
_sets = (ctypes.c_uint32 * 6)()
_libc.capget(_header, _sets)
for _word in range(3):
    _sets[_word] &= ~(1 << 23)  # CAP_SYS_NICE
assert _libc.capset(_header, _sets) == 0
"""
_CLOCK_BACK = """
import time as _time
_began, _now, _now_ns = _time.monotonic(), _time.time, _time.time_ns
def _back_s():
    return 3600 if _time.monotonic() - _began > 4.0 else 0
_time.time, _time.time_ns = lambda: _now() - _back_s(), lambda: _now_ns() - _back_s() * 10**9
"""
_PAYLOAD_OFF = """
import sim_robot.plant as plant
from dataclasses import replace
_draw, _arms = plant.draw_estimate_error, []
def _heavier(*of):
    _arms.append(of)
    return replace(_draw(*of), payload_kg={kg} if len(_arms) == 1 else 0.0)
plant.draw_estimate_error = _heavier
"""
_STOP_REJECTED = """
from sim_robot.fci.arm_server import ArmServer
from sim_robot.fci.protocol import Command
_reply_later = ArmServer._reply_later
def _rejected(self, command, command_id, status, *more):
    return _reply_later(self, command, command_id, 1 if command == Command.STOP_MOVE else status, *more)
ArmServer._reply_later = _rejected
"""
_LATE_THREE_QUARTERS = "".join(
    _fault("answers_lost", round(1.0 + 0.02 * k, 3), arm="both", duration_s=0.015) for k in range(50)
)
_PANDAS = ((r'^(address = "127[^:"]*")', r'\1\nmodel = "fer"'),)
_HELD = {"when": "first_contact", "delay_s": 1.0}
_FIRST_STATES = 600  # ms of motion: on the way to the object

WRONG = (
    # files
    Setup("no file of the cell", METAL, cell_file=False, real_address=True),
    Setup("simulated = true at a real address", METAL, ((r"simulated = false", "simulated = true"),),
          real_address=True),
    Setup("addresses exchanged", METAL, kind="fci:{metal.right},{metal.left}"),
    Setup("no calibration", METAL, ((r"\[calibration\]", ""), (r"date = .*", ""), (r"rms_mm = .*", ""))),
    Setup("stale calibration", METAL, ((r"date = .*", "date = 2026-01-01"),)),
    Setup("calibration in the future", METAL, ((r"date = .*", "date = 2099-01-01"),)),
    Setup("calibration with rms 9 mm", METAL, ((r"rms_mm = .*", "rms_mm = 9.0"),)),
    Setup("gains x 10", METAL, ((r"# \[gains\]", "[gains]"), (
        r"# stiffness = .*", "stiffness = [15000.0, 15000.0, 15000.0, 200.0, 200.0, 200.0]"))),
    Setup("home in deg", METAL, begins(tuple(np.round(np.degrees(HOME), 3).tolist()))),
    Setup("start speed in deg/s", METAL, ((r"speed_rad_s = .*", "speed_rad_s = 23.0"),)),
    Setup("pad 350 kg", METAL, ((r"mass = 0\.35", "mass = 350.0"),)),
    Setup("bases in mm", METAL, _bases(lambda base: 1000.0 * base)),
    Setup("base orientation xyzw", METAL, ((
        r"base_orientation_wxyz = .*", "base_orientation_wxyz = [0.0, 0.0, 0.0, 1.0]"),)),
    Setup("object 1250 kg in the file", METAL, ((r"mass = 1\.25", "mass = 1250.0"),)),
    Setup("no [safety]", METAL, ((r"ee_lower = .*", ""), (r"ee_upper = .*", ""), (r"ee_speed_max = .*", ""),
                                 (r"power_max = .*", ""), (r"\[safety\]", ""))),
    Setup("another name typed", METAL, types="grub"),
    Setup("serial numbers exchanged", METAL, desk="exchanged"),
    Setup("generic kernel at a real address", METAL, ((r"enforce_realtime = false.*", ""),), real_address=True,
          desk="started"),
    Setup("no SCHED_FIFO at a real address", METAL, ((r"enforce_realtime = false.*", ""),), prelude=_NO_FIFO,
          real_address=True, desk="started"),
    # the plant is another one than the file's
    Setup("arms swapped", METAL, profile="[built]\nswapped = true\n"),
    Setup("tracker's axes swapped", METAL, profile="[built]\ntracker_deg = [0.0, 0.0, 90.0]\n",
          options=("--displacement-mm", "45", "--displacement-x-mm", "-45")),
    Setup("table 30 mm higher, arms above home", METAL, scene=(*begins(HIGH), (r"top_z = .*", "top_z = 0.23")),
          options=("--object", "none"), command=PLAY),
    Setup("payload off by 2 kg", METAL, robot=_PAYLOAD_OFF.format(kg=2), command=TEACH),
    Setup("pads 30 mm longer than the file has them", METAL,
          scene=((r"flange_to_face = .*", "flange_to_face = 0.06"),), command=TEACH),
    Setup("pads 30 mm shorter than the file has them", METAL,
          ((r"flange_to_face = .*", "flange_to_face = 0.06"),), command=TEACH),
    Setup("object 10 x heavier", METAL, scene=((r"mass = 1\.25", "mass = 12.5"),)),
    Setup("bases 150 mm off along x, opposite", METAL,
          profile="[built]\nleft_mm = [150.0, 0.0, 0.0]\nright_mm = [-150.0, 0.0, 0.0]\n"),
    # meanwhile
    Setup("log's disk full after 1 MB", METAL, act=_full_disk(1_000_000)),
    Setup("answers lost for 12 ms", METAL, faults=_fault("answers_lost", 1.0, arm="both", duration_s=0.012),
          harmless="a robot bridges them"),
    Setup("answers lost for 30 ms", METAL, faults=_fault("answers_lost", 1.0, arm="both", duration_s=0.03)),
    Setup("program stands still for 12 ms", METAL, act=_after(_FIRST_STATES, _suspend(0.012)),
          harmless="a robot bridges it"),
    Setup("program stands still for 2 s", METAL, act=_after(_FIRST_STATES, _suspend(2.0))),
    Setup("three answers in four lost for a second", METAL, faults=_LATE_THREE_QUARTERS),
    Setup("user stop of one arm while carrying", METAL, faults=_fault("user_stop", None, arm="left", **_HELD)),
    Setup("space bar let go", METAL, let_go_ms=_FIRST_STATES),
    Setup("terminal closed", METAL, let_go_ms=_FIRST_STATES, hang_up=True),
    Setup("two operators; the second one presses STOP", METAL, page=_second_operator),
    Setup("console's process stands still for 3 s", METAL, page=_console_frozen),
    Setup("StopMove rejected by the box", METAL, robot=_STOP_REJECTED, let_go_ms=_FIRST_STATES),
    # these are not in the published list
    Setup("FCI off on Desk", desk="off"),
    Setup("no serial number at a real address", real_address=True),
    Setup("pads of bare metal, friction 0.05", scene=((r"friction = 0\.9", "friction = 0.05"),)),
    Setup("pads 180 mm wide", scene=((r"size = \[0\.1, 0\.1, 0\.03\]", "size = [0.18, 0.1, 0.03]"),),
          harmless="the face's middle is where it should be, and nothing stands beside the object"),
    Setup("sides mirrored in the file", file=(
        (re.escape("base_position = [-0.4, 0.5, 0.0]"), "base_position = [-0.4, -0.51, 0.0]"),
        (re.escape("base_position = [-0.4, -0.5, 0.0]"), "base_position = [-0.4, 0.5, 0.0]"))),
    Setup("boxes' cables exchanged at the switch",
          options=("--left", "{metal.right}", "--right", "{metal.left}")),
    Setup("cable of the right box out", faults=_fault("states_lost", 1.0, arm="right")
          + _fault("answers_lost", 1.0, arm="right")),
    Setup("right box closes the connection", faults=_fault("disconnect", 1.0, arm="right")),
    Setup("tracker absent", options=("--tracker", "")),
    Setup("tracker frozen from before", faults=_fault("tracker_frozen", 0.0),
          harmless="a trial looks for the object before it moves; then it goes by what the arms feel"),
    Setup("tracker turned by 180 deg, object displaced", profile="[built]\ntracker_deg = [0.0, 0.0, 180.0]\n",
          options=("--displacement-mm", "50"),
          harmless="within the tolerance of its place, and the arms find it by what they feel"),
    Setup("tracker 200 mm off in z", profile="[built]\ntracker_mm = [0.0, 0.0, 200.0]\n"),
    Setup("file of two Pandas", file=_PANDAS),
    Setup("two Pandas stand there", plant_file=_PANDAS),
    Setup("another client on the right box", before=_other_client),
    Setup("second program while the first moves", act=_after(_FIRST_STATES, _second_client),
          harmless="the first program goes on; the second one is refused"),
    Setup("table 50 mm lower", scene=((r"top_z = .*", "top_z = 0.15"),)),
    Setup("table 9 mm higher", scene=((r"top_z = .*", "top_z = 0.209"),),
          harmless="the pads pass 1 mm above it, and the object is set down on it 9 mm earlier"),
    Setup("object not there", options=("--object", "none")),
    Setup("object not there, demonstration", options=("--object", "none"), command=TEACH),
    Setup("object twice as heavy", scene=((r"mass = 1\.25", "mass = 2.5"),),
          harmless="it was lifted, with forces within all bounds"),
    Setup("another object: the lowest", options=("--object", "box_060"),
          harmless="it was lifted, with forces within all bounds"),
    Setup("object turned by 30 deg", options=("--yaw-deg", "30")),
    Setup("object 55 mm off its place", options=("--displacement-mm", "55"),
          harmless="within the tolerance of its place, and the arms find it by what they feel"),
    Setup("object 90 mm off its place", options=("--displacement-x-mm", "90")),
    Setup("payload off by 0.5 kg", robot=_PAYLOAD_OFF.format(kg=0.5),
          harmless="a warning names the kilograms, and the forces are within all bounds"),
    Setup("payload off by 1 kg, playback", robot=_PAYLOAD_OFF.format(kg=1), command=PLAY,
          options=("--object", "none")),
    Setup("home inside the table", file=begins(LOW), scene=begins(HIGH), command=TEACH),
    Setup("calibration 200 mm too high in z", file=_bases(lambda base: base + (0.0, 0.0, 0.2)), command=TEACH),
    Setup("calibration 200 mm too low in z", file=_bases(lambda base: base - (0.0, 0.0, 0.2)), command=TEACH),
    Setup("bases 100 mm lower than the file has them",
          scene=begins(HIGH), profile="[built]\nleft_mm = [0.0, 0.0, -100.0]\nright_mm = [0.0, 0.0, -100.0]\n",
          command=TEACH),
    Setup("left base 5 deg turned about z", profile="[built]\nleft_deg = [0.0, 0.0, 5.0]\n"),
    Setup("firmware 4 of FCI", robot="import sim_robot.fci.link as link\nlink.VERSION = 9\n"),
    Setup("no room for a log at all", act=_full_disk(100)),
    Setup("log exists already", more=("--log", "{metal.cell_file}")),
    Setup("clock set back by an hour", prelude=_CLOCK_BACK, harmless="no decision of the loop uses the time of day"),
    Setup("terminal suspended for 2 s, Ctrl-Z", act=_after(_FIRST_STATES, _suspend(2.0, signal.SIGTSTP))),
    Setup("robot's process killed", act=_after(_FIRST_STATES, _kill_robot)),
    Setup("page's connection gone while a hand leads", page=_page_gone),
    Setup("user stop of both arms on the way", faults=_fault("user_stop", 0.6, arm="both")),
    Setup("user stop pressed from before", faults=_fault("mode", None, arm="left", state="guiding")),
    Setup("brakes locked", faults=_fault("mode", None, arm="both", state="brakes_locked")),
    Setup("arms 1.6 rad from home", scene=begins(FAR)),
    Setup("a person leans on an arm with 60 N", faults=_fault("push", 0.6, arm="left", force_N=[0.0, 60.0, 0.0])),
    Setup("a joint's torque sensor off by 15 Nm", faults=_fault(
        "tau_sensor_bias", 0.6, arm="left", bias_Nm=[0.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0])),
    Setup("states frozen", faults=_fault("state_frozen", 0.6, arm="right")),
    Setup("a robot on a bad day (harsh)", options=("--profile", "harsh"),
          harmless="what users report of robots that work"),
)  # fmt: skip
