"""The topic table. Rings, log, schema, reader, review, CSV, live feed and the log's documentation are made from it.

A topic that is added here, or that an installed package offers, is in all of them: docs/howto/topic.md.
"""

from collections.abc import Iterable, Sequence

from hal.base.record import MATRIX, POSITION, TWIST, WRENCH, Field
from hal.base.record import POSE as POSE_AXES
from hal.cycle import CYCLE_FIELDS, WORK_FIELDS
from hal.extensions import ExtensionPoint
from hal.topic import Message, Topic
from hal.tracker import OBJECT_POSE_FIELDS
from rtstack.samples import ARM_FIELDS, CONTROL_FIELDS, EVENT_FIELDS, SIDES, TIMING_FIELDS

ARM = Message(
    "rtstack.ArmSample",
    "State of one arm, with libfranka's names and units, and the torques wanted and applied.",
    ARM_FIELDS,
)
CONTROL = Message("rtstack.ControlSample", "What the controller of one arm did in this tick.", CONTROL_FIELDS)
TIMING = Message("rtstack.TimingSample", "How the real-time loop kept time.", TIMING_FIELDS)
CYCLE = Message(
    "rtstack.CycleSample", "When a state came and was answered, where each arm has a clock of its own.", CYCLE_FIELDS
)
WORK = Message("rtstack.WorkSample", "What the host did with the real-time loop.", WORK_FIELDS)
POSE = Message("foxglove.PoseInFrame", "Pose of an object, in a frame.", OBJECT_POSE_FIELDS)
EVENT = Message("foxglove.Log", "Something that happened.", EVENT_FIELDS)

HAND = Message(
    "rtstack.HandSample",
    "A command of teleoperation that was applied, and the picture that it answers. Filtered it is pose_ref.",
    (
        *(
            Field(f"asked_{side}", f"Requested pose T_world_ee, {side}: m, quaternion.", "m", POSE_AXES, "world")
            for side in SIDES
        ),
        Field("sequence", "Number of the command, as its sender counts.", kind="i8"),
        Field("picture", "Number of the picture that its sender saw, as the console counts.", kind="i8"),
        Field("made_us", "From when it was made until its torque was sent, {unit}.", "us", host_clock=True),
        Field("came_us", "From when the console had it until its torque was sent, {unit}.", "us", host_clock=True),
        Field("picture_us", "From the picture's robot state until then, {unit}.", "us", host_clock=True),
        Field("seen_us", "From when the picture was seen until then, {unit}.", "us", host_clock=True),
        Field("dropped_old", "Commands so far that were too old to be applied.", kind="i8", host_clock=True),
        Field("dropped_order", "Commands so far that came after a later one.", kind="i8", host_clock=True),
        Field("dropped_picture", "Commands so far that were made on an old picture.", kind="i8", host_clock=True),
        Field("dropped_other", "Commands so far that were not applied for another reason.", kind="i8", host_clock=True),
    ),
)
CLOCK = Message(
    "rtstack.ClockSample",
    "How the robot's time is the host's: a line through the states that were delayed least, of the last 20 s.",
    (
        Field(
            "unix_ns", "Unix time of this message's log time, {unit}, the states' least delay with it.",
            "ns", kind="i8", host_clock=True, plotted=False,
        ),
        Field("drift_ppm", "By how much the host's clock is faster than the robot's, {unit}.", "ppm", host_clock=True),
        Field(
            "uncertainty_us", "How far the least delayed states are off the line, rms, {unit}.", "us", host_clock=True,
        ),
        Field("steps", "How often one of the clocks has made a step.", kind="i8", host_clock=True, plotted=False),
    ),
)  # fmt: skip

ARM_TOPICS = tuple(f"/{side}/arm" for side in SIDES)
CONTROL_TOPICS = tuple(f"/{side}/control" for side in SIDES)
CYCLE_TOPICS = tuple(f"/{side}/cycle" for side in SIDES)
WORK_TOPIC = "/host/work"
TIMING_TOPIC, OBJECT_TOPIC, EVENT_TOPIC, CLOCK_TOPIC = "/timing", "/object/pose", "/events", "/clock"
HAND_TOPIC = "/hand"


def topic_table(rows: Iterable[Topic]) -> dict[str, Topic]:
    """Return the rows by name. Raises ValueError for two that cannot be told apart."""
    table: dict[str, Topic] = {}
    curves: dict[tuple[str, str], str] = {}
    schemas: dict[str, Message] = {POSE.schema: POSE, EVENT.schema: EVENT}
    for topic in rows:
        if not topic.message.is_ours and topic.message.schema not in schemas:
            raise ValueError(f"{topic.name}: schema {topic.message.schema}: expected rtstack.NAME")
        if schemas.setdefault(topic.message.schema, topic.message) != topic.message:
            raise ValueError(f"{topic.name}: schema {topic.message.schema} is another topic's: rename one")
        if topic.name in table:
            raise ValueError(f"there are two topics {topic.name}")
        table[topic.name] = topic
        for field in topic.plotted_fields:
            other = curves.setdefault((topic.group, field.name), topic.name)
            if other != topic.name:
                raise ValueError(f"{topic.name} and {other} both have a curve {topic.group}.{field.name}: rename one")
    return table


def _with_offered(rows: Sequence[Topic]) -> tuple[dict[str, Topic], tuple[str, ...]]:
    """Return the table with the topics that installed packages offer, and one line for each that cannot be in it."""
    offered, refused = OFFERED.loadable()
    taken, reasons = list(rows), list(refused)
    for name, topic in offered.items():
        try:
            topic_table([*taken, topic])
            taken.append(topic)
        except ValueError as error:
            reasons.append(f"topic {name!r} of another package: {error}")
    return topic_table(taken), tuple(reasons)


OFFERED = ExtensionPoint("rtstack.topics", "topic", Topic)  # the modules that offer one import hal only
_TABLE = _with_offered(
    [
        *(Topic(name, ARM, 1000, every_tick=True) for name in ARM_TOPICS),
        *(Topic(name, CONTROL, 1000, every_tick=True) for name in CONTROL_TOPICS),
        Topic(TIMING_TOPIC, TIMING, 1000, every_tick=True),
        Topic(OBJECT_TOPIC, POSE, 100, "what the tracker saw"),
        Topic(CLOCK_TOPIC, CLOCK, 10, "where the arms keep their own time: Unix time of the robot's"),
        Topic(EVENT_TOPIC, EVENT, 0, "who (`name`), what (`message`), how severe", plotted=False),
        *(Topic(name, CYCLE, 1000, plotted=False) for name in CYCLE_TOPICS),
        Topic(WORK_TOPIC, WORK, 125, plotted=False),
        Topic(HAND_TOPIC, HAND, 100, "of teleoperations", plotted=False),
    ]
)
TOPICS: dict[str, Topic] = _TABLE[0]
"""All topics by name, in the order of the log: of samples of one time the first topic comes first."""
REFUSED: tuple[str, ...] = _TABLE[1]
TICK_TOPICS = tuple(topic.name for topic in TOPICS.values() if topic.every_tick)
PLOTTED_TOPICS = tuple(topic.name for topic in TOPICS.values() if topic.plotted)
MESSAGES: dict[str, Message] = {t.message.name: t.message for t in TOPICS.values() if t.message.is_ours}
HOST_CLOCK_FIELDS: dict[str, tuple[str, ...]] = {
    name: clocked
    for name, topic in TOPICS.items()
    if (clocked := tuple(field.name for field in topic.message.fields if field.host_clock))
}
_SYMBOLS = {"us": "µs", "rad/s^2": "rad/s²"}  # units of the table, which is ASCII, as a page shows them
_MIXED = {"force_norm": "N, Nm"}  # (33) adds both; its text in the log's schema does not say so


def unit_of(field: Field, component: str) -> str:
    """Return the unit of one component: of a wrench N or Nm, of a twist m/s or rad/s, of a rotation none."""
    unit = _MIXED.get(field.name, field.unit)
    if field.axes in (WRENCH, TWIST):
        unit = unit.split(", ")[field.axes.index(component) // 3]
    elif field.axes in (POSE_AXES, MATRIX) and component not in POSITION:
        unit = ""
    return _SYMBOLS.get(unit, unit)
