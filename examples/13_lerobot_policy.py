"""A policy of LeRobot leads the arms of a running stack. It runs where lerobot is installed: rtstack need not be there.

rtstack up                                              # in a terminal of its own: prints an address
rtstack token create --name lerobot --scope operate
python 13_lerobot_policy.py trained/checkpoints/last/pretrained_model http://127.0.0.1:8080 TOKEN

CHECKPOINT is a folder that lerobot-train has saved, of a data set of rtstack export --to lerobot. An operator lets it
lead; it ends when its lease is over.
"""

import asyncio
import base64
import io
import json
import sys

import aiohttp  # comes with lerobot
import numpy as np
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from lerobot.policies.utils import prepare_observation_for_inference
from PIL import Image

FPS = 50  # of the data set: rtstack export --fps
CHUNK_HZ = 20  # how often a policy is asked that answers in chunks; any other one is asked once a frame
POSES = 16  # of an answer, at most
TASK = "grab the rice box with both arms"  # for a policy that reads it


def frame_of(shown, names):
    """Return an observation as a frame of the data set: arrays, by these names."""
    pose = shown["object_pose"]
    frame = {
        "observation.state": np.float32([shown["q"], shown["dq"]]).reshape(28),
        "observation.environment_state": np.float32([*(pose or [0.0] * 7), pose is not None]),
    }
    for camera, picture in shown["pictures"].items():
        jpeg = io.BytesIO(base64.b64decode(picture["jpeg"]))
        frame[f"observation.images.{camera}"] = np.array(Image.open(jpeg).convert("RGB"))
    return {name: frame[name] for name in names}


def answer_to(shown, actions):
    """Return the answer of actions (n, 14), one a frame: poses of both pads, with quaternions of length one."""
    poses = np.array(actions, float).reshape(-1, 2, 7)
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    return {"to": shown["number"], "step_s": 1.0 / FPS, "poses": poses.tolist()}


class LeRobotPolicy:
    """A saved policy with its processors."""

    def __init__(self, folder):
        self._config = config = PreTrainedConfig.from_pretrained(folder)
        self._policy = get_policy_class(config.type).from_pretrained(folder, config=config)
        device = {"device_processor": {"device": config.device}}
        self._before, self._after = make_pre_post_processors(config, folder, preprocessor_overrides=device)
        self._follows = config.n_action_steps if hasattr(config, "chunk_size") else 1  # actions of a chunk
        self._chunk, self._from_ns = None, 0
        self.rate_hz = CHUNK_HZ if self._follows > 1 else FPS
        self._ask({name: torch.zeros(feature.shape) for name, feature in config.input_features.items()})
        self._policy.reset()  # the first call takes longer than the arms would wait

    def actions(self, shown):
        """Return what is to be done from an observation on, (n, 14), one action a frame."""
        done = (shown["t_ns"] - self._from_ns) * 1e-9 * FPS  # of the chunk, in frames
        if self._chunk is None or self._follows == 1 or not 0.0 <= done < self._follows:
            frame = frame_of(shown, self._config.input_features)
            self._chunk = self._ask(prepare_observation_for_inference(frame, self._config.device))
            self._from_ns, done = shown["t_ns"], 0.0
        if self._follows == 1:
            return self._chunk
        known = np.arange(len(self._chunk))
        return np.stack([np.interp(done + np.arange(POSES), known, each) for each in self._chunk.T], axis=1)

    def _ask(self, frame):
        with torch.inference_mode():
            batch = self._before(frame | {"task": TASK})
            if self._follows > 1:
                actions = self._policy.predict_action_chunk(batch)[0]
            else:
                actions = self._policy.select_action(batch)
            return np.concatenate([self._after(each[None]).numpy() for each in actions])


async def lead(policy, address, token):
    """Answer observations until the lease is over, or the connection. Returns how many were answered."""
    answered = 0
    headers = {"authorization": f"Bearer {token}"}
    url = f"{address.rstrip('/')}/api/policy?rate_hz={policy.rate_hz}"
    async with aiohttp.ClientSession(headers=headers) as session, session.ws_connect(url, max_msg_size=0) as stream:
        while (message := await stream.receive()).type is aiohttp.WSMsgType.TEXT:
            said = json.loads(message.data)
            if "observation" not in said:
                if answered:
                    break
                continue
            if said["refused"]:
                print("refused:", said["refused"], flush=True)
            await stream.send_json(answer_to(said["observation"], policy.actions(said["observation"])))
            answered += 1
    return answered


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit("usage: python 13_lerobot_policy.py CHECKPOINT ADDRESS TOKEN")
    policy = LeRobotPolicy(sys.argv[1])
    print("waits for a lease", flush=True)
    try:
        print("answered", asyncio.run(lead(policy, *sys.argv[2:])), "observations")
    except (aiohttp.ClientError, ConnectionError) as error:
        sys.exit(f"the connection to {sys.argv[2]} has broken: {error}")
