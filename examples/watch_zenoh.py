"""Saves the newest image of every renderer of a run, without readygo: python watch_zenoh.py ENDPOINT RUN FOLDER."""

import json
import os
import sys
import time
from pathlib import Path

import msgpack
import zenoh

endpoint, run, folder = sys.argv[1:]


def keep(sample: zenoh.Sample) -> None:
    """Write a renderer's newest image to a file."""
    preview = msgpack.unpackb(sample.payload.to_bytes())
    episode = preview["episode"]
    name = f"{episode['split']}-{episode['seed']}-{episode['index']:06d}.{preview['format']}"
    (Path(folder) / name).write_bytes(preview["image"])


config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([endpoint]))
if token := os.environ.get("READYGO_TOKEN"):
    config.insert_json5("transport/auth/usrpwd/user", '"run"')
    config.insert_json5("transport/auth/usrpwd/password", json.dumps(token))
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber(f"readygo/{run}/live/*/*/preview", keep)
    while True:
        time.sleep(1)
