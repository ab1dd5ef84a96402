"""A short log with a camera's pictures."""

from rtstack.log.reader import read_log
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.log.writing.pictures import camera_schemas, picture_message
from rtstack.topics import TOPICS
from tests.support.console.review_log import MS, stamped_pictures


def write_seen_log(source, target, count=12):
    """Write the log `source` again, with pictures every 33 ms from 5 ms on; return the camera, and (t_ns, JPEG)."""
    log = read_log(source)
    ((camera, shown),) = stamped_pictures({"front": 33})
    shown = [(log.start_ns + t_ns + 5 * MS, jpeg) for t_ns, jpeg in shown[:count]]
    with open(target, "wb") as file:
        writer = McapWriter(file, camera_schemas(camera.name))
        writer.begin([("trial", log.metadata["trial"])], log.attachments)
        images = {camera.topics[0]: [(t_ns, picture_message(camera.name, t_ns, jpeg)) for t_ns, jpeg in shown]}
        writer.write({topic: log.topic(topic) for topic in TOPICS}, images | camera.about(log.start_ns))
        writer.write_metadata("result", log.metadata.get("result", {"success": "true"}))
        writer.close()
    return camera, shown
