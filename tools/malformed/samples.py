"""Valid inputs of every kind, and the commands that read them."""

import gzip
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from slrl_sumo.formats.trajectories import Trajectories

SHIPPED = Path(__file__).parents[2]
RUN = ("--agents", "4", "--steps", "1", "--quiet")
ADDITIONAL = (
    '<additional><vType id="odd" vClass="passenger" length="4.5" width="1.8" maxSpeed="40"/>'
    '<poly id="p" shape="0,0 5,0 5,5" color="red" layer="1"/></additional>'
)


@dataclass(frozen=True)
class Sample:
    """A valid input: a folder, the file of it that is mutated, and a command in that folder that reads it."""

    name: str
    kind: str
    """How the file is written: xml, csv, json, toml, npz, png, weights, other."""
    folder: Path
    target: str
    command: tuple[str, ...]


def make_samples(base: Path) -> list[Sample]:
    """Write the valid inputs into folders below `base`."""
    return [*_scenarios(base), *_traces(base), *_trajectories(base), *_recordings(base), *_bundles(base)]


def make_studies(base: Path, run: Callable[[tuple[str, ...], Path], object]) -> list[Sample]:
    """Studies, recordings and trainings that can be resumed; `run` runs a command in a folder."""
    studies = {
        "evaluate": (
            *("evaluate", "intersection", "--bundle", "intersection", "--selectors", "greedy", "--agents", "4"),
            *("--episodes", "1", "--steps", "2", "--workers", "1", "--out", "out"),
        ),
        "compare": ("compare", "s", "--bundle", "intersection", "--seeds", "1", "--steps", "3", "--workers", "1"),
        "record": ("record", "intersection", "--seconds", "4", "--seeds", "1", "--workers", "1", "--out", "out"),
        "train": (
            *("train", "intersection", "--bundle", "shared-space", "--out", "out", "--steps", "64", "--workers", "1"),
            *("--config", "a.toml", "--episodes", "0"),
        ),
    }
    targets = {
        "evaluate": (("json", "out/episodes.jsonl"),),
        "compare": (("json", "out/runs.jsonl"),),
        "record": (("json", "out/recordings.json"),),
        "train": (
            ("other", "out-training/checkpoint.pt"),
            ("json", "out-training/settings.json"),
            ("csv", "out-training/log.csv"),
        ),
    }
    made = []
    for name, words in studies.items():
        folder = base / name
        folder.mkdir()
        if name == "compare":
            _scenario(folder / "s")
            words = (*words, "--out", "out")
        if name == "train":
            (folder / "a.toml").write_text(SETTINGS)
        run(words, folder)
        again = (*words, "--resume") if name == "train" else words
        made += [Sample(f"{name} {Path(t).name}", kind, folder, t, again) for kind, t in targets[name]]
    return made


SETTINGS = """[ppo]
num_steps = 8
num_minibatches = 2
update_epochs = 1
learning_rate = 0.0003
[reward]
speed = 0.5
[arena]
agents = 4
[policy]
preset = "extended"
channels = [4, 4]
[networks]
count = 1
reset_every = 1
[imitation]
epochs = 0
"""


def _scenario(folder: Path) -> None:
    shutil.copytree(SHIPPED / "sumo_scenarios" / "intersection", folder)
    (folder / "a.add.xml").write_text(ADDITIONAL)
    config = folder / "intersection.sumocfg"
    text = config.read_text().replace("</input>", '<additional-files value="a.add.xml"/></input>')
    config.write_text(text.replace('<end value="600"/>', '<end value="20"/>'))


def _scenarios(base: Path) -> list[Sample]:
    _scenario(base / "scenario" / "s")
    packed = base / "packed" / "s"
    _scenario(packed)
    for name in ("net", "rou"):
        file = packed / f"intersection.{name}.xml"
        (packed / f"{file.name}.gz").write_bytes(gzip.compress(file.read_bytes()))
        file.unlink()
    config = packed / "intersection.sumocfg"
    config.write_text(config.read_text().replace('.net.xml"', '.net.xml.gz"').replace('.rou.xml"', '.rou.xml.gz"'))
    cfg = "s/intersection.sumocfg"
    made = []
    for place, named in (
        ("scenario", ("intersection.sumocfg", "intersection.net.xml", "intersection.rou.xml", "a.add.xml")),
        ("packed", ("intersection.net.xml.gz", "intersection.rou.xml.gz")),
    ):
        for name in named:
            for words in (("doctor", cfg), ("run", cfg, *RUN))[: 1 if name == "a.add.xml" else 2]:
                made.append(Sample(f"{words[0]} {name}", "xml", base / place, f"s/{name}", words))
    return made


def _trace() -> str:
    steps = "".join(
        f'<timestep time="{0.4 * k:.2f}"><vehicle id="v" x="{4.0 * k:.2f}" y="8.00" angle="90.00" type="car" '
        f'speed="10.00" pos="1.00" lane="a_0" slope="0.00"/><person id="p" x="{0.4 * k:.2f}" y="3.00" angle="90.00" '
        'speed="1.00" pos="1.00" edge="a" slope="0.00"/></timestep>\n'
        for k in range(40)
    )
    return f"<fcd-export>{steps}</fcd-export>"


def _traces(base: Path) -> list[Sample]:
    folder = base / "traces"
    folder.mkdir()
    (folder / "t.xml").write_text(_trace())
    (folder / "t.xml.gz").write_bytes(gzip.compress(_trace().encode()))
    names = "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle;vehicle_type;vehicle_speed;mode;learned"
    rows = [f"{0.4 * k:.2f};v;{4.0 * k:.2f};8.00;90.00;car;10.00;{k % 20};1" for k in range(40)]
    (folder / "t.csv").write_text("\n".join([names, *rows]) + "\n")
    kinds = {"t.xml": "xml", "t.xml.gz": "xml", "t.csv": "csv"}
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        pass
    else:
        cells = list(zip(*(row.split(";") for row in rows), strict=True))
        numbers = {0, 2, 3, 4, 6}
        columns = [[float(v) for v in c] if i in numbers else list(c) for i, c in enumerate(cells)]
        pq.write_table(pa.table(dict(zip(names.split(";"), columns, strict=True))), folder / "t.parquet")
        kinds["t.parquet"] = "other"
    shutil.copy(SHIPPED / "sumo_scenarios" / "intersection" / "intersection.net.xml", folder / "n.net.xml")
    made = [
        Sample("replay --net", "xml", folder, "n.net.xml", ("replay", "t.csv", "--net", "n.net.xml", "--out", "r.html"))
    ]
    for file, kind in kinds.items():
        made.append(Sample(f"import {file}", kind, folder, file, ("import", "fcd", file, "--out", "o.npz")))
        words = ("replay", file, "--net", "n.net.xml", "--out", "r.html")
        made.append(Sample(f"replay {file}", kind, folder, file, words))
    return made


def _trajectories(base: Path) -> list[Sample]:
    folder = base / "trajectories"
    folder.mkdir()
    tracks, frames = 6, 40
    frame = np.tile(np.arange(frames), tracks)
    track = np.repeat(np.arange(tracks), frames)
    kind = np.arange(tracks, dtype=np.int8) % 3
    Trajectories(
        track=track,
        frame=frame,
        x=5.0 + 0.4 * frame * np.array([8.0, 4.0, 1.2])[kind[track]],
        y=np.array(-5.0 - 4.0 * track, np.float64),
        heading=np.zeros(len(track)),
        ids=tuple(f"t{i}" for i in range(tracks)),
        type=kind,
        length=np.array([4.5, 1.8, 0.4])[kind],
        width=np.array([1.8, 0.6, 0.5])[kind],
    ).save(folder / "a.npz")
    cv2.imwrite(str(folder / "m.png"), np.full((80, 300, 3), 255, np.uint8))
    evaluate = ("evaluate", "a.npz", "--bundle", "shared-space", "--selectors", "prior", "--starts", "10", "--out", "o")
    fit = ("fit", "a.npz", "--epochs", "1", "--out", "b")
    run = ("run", "intersection", *RUN, "--report", "r", "--recording", "a.npz")
    masked = (*evaluate, "--mask", "m.png", "--metres-per-pixel", "0.5")
    return [
        Sample("evaluate a.npz", "npz", folder, "a.npz", evaluate),
        Sample("fit a.npz", "npz", folder, "a.npz", fit),
        Sample("run --recording", "npz", folder, "a.npz", run),
        Sample("evaluate --mask", "png", folder, "m.png", masked),
    ]


def _recordings(base: Path) -> list[Sample]:
    folder = base / "recordings"
    folder.mkdir()
    frames = range(60)
    heads = {
        "levelx/07_tracks.csv": "recordingId,trackId,frame,xCenter,yCenter,heading",
        "levelx/07_tracksMeta.csv": "recordingId,trackId,numFrames,width,length,class",
        "levelx/07_recordingMeta.csv": "recordingId,frameRate",
        "sind/r/Veh_smoothed_tracks.csv": "track_id,timestamp_ms,agent_type,x,y,yaw_rad,length,width",
        "sind/r/Ped_smoothed_tracks.csv": "track_id,timestamp_ms,agent_type,x,y",
        "interaction/r/vehicle_tracks_000.csv": "track_id,timestamp_ms,agent_type,x,y,psi_rad,length,width",
        "dut/a_traj_ped_filtered.csv": "id,frame,label,x_est,y_est",
        "dut/a_traj_veh_filtered.csv": "id,frame,label,x_est,y_est,psi_est",
    }
    rows = {
        "levelx/07_tracks.csv": [f"7,1,{f},{0.2 * f:.2f},0,0" for f in frames],
        "levelx/07_tracksMeta.csv": ["7,1,60,1.8,4.5,car"],
        "levelx/07_recordingMeta.csv": ["7,25"],
        "sind/r/Veh_smoothed_tracks.csv": [f"0,{100 * f},car,{0.5 * f:.2f},0,0,4.5,1.8" for f in frames],
        "sind/r/Ped_smoothed_tracks.csv": [f"P1,{100 * f},pedestrian,3,{0.12 * f:.2f}" for f in frames],
        "interaction/r/vehicle_tracks_000.csv": [f"1,{100 * f},car,{0.5 * f:.2f},0,0,4.5,1.8" for f in frames],
        "dut/a_traj_ped_filtered.csv": [f"0,{f},ped,5,{0.05 * f:.2f}" for f in frames],
        "dut/a_traj_veh_filtered.csv": [f"0,{f},veh,{0.3 * f:.2f},0,0" for f in frames],
        "hc/D7.csv": [f"{f},{u},{30 * f},{-40 * u},{u}" for u in (1, 2, 3) for f in frames],
    }
    for file, lines in rows.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text("\n".join([*([heads[file]] if file in heads else []), *lines]) + "\n")
    video = folder / "sdd" / "gates" / "video3"
    video.mkdir(parents=True)
    (folder / "sdd" / "estimated_scales.yaml").write_text("gates:\n   video3:\n      scale: 0.04\n")
    boxes = [f'0 {3 * f} 10 {3 * f + 40} 50 {f} 0 0 0 "Biker"' for f in frames]
    (video / "annotations.txt").write_text("\n".join(boxes) + "\n")
    made = []
    for file in (*rows, "sdd/gates/video3/annotations.txt", "sdd/estimated_scales.yaml"):
        name = file.split("/")[0]
        words = ("import", name, name, "--out", "o.npz")
        made.append(Sample(f"import {file}", "csv", folder, file, words))
    return made


def _bundles(base: Path) -> list[Sample]:
    folder = base / "bundles"
    shutil.copytree(SHIPPED / "slrl_sumo" / "bundles" / "intersection", folder / "b")
    shutil.copy(base / "trajectories" / "a.npz", folder)
    (folder / "a.toml").write_text(SETTINGS)
    # The folder of a training: after the settings are read, the command ends because there is one.
    (folder / "o-training").mkdir()
    (folder / "o-training" / "checkpoint.pt").touch()
    words = ("evaluate", "a.npz", "--bundle", "b", "--selectors", "prior", "--starts", "30", "--out", "o2")
    kinds = {"config.json": "json", "training.json": "json", "selector.json": "json", "MODEL_CARD.md": "other"}
    kinds |= {"weights.safetensors": "weights", "selector.safetensors": "weights"}
    train = ("train", "intersection", "--bundle", "intersection", "--out", "o", "--config", "a.toml", "--steps", "64")
    return [
        *(Sample(f"evaluate --bundle {file}", kind, folder, f"b/{file}", words) for file, kind in kinds.items()),
        Sample("train --config", "toml", folder, "a.toml", train),
    ]
