"""Training data: random ray-traced scenes in shards. Reading shards does not need torch."""

from bokehnet.synth.config import ClutterConfig, SceneConfig, SynthConfig
from bokehnet.synth.dataset import write_dataset
from bokehnet.synth.shards import ShardSet, TrainingSample, read_sample

__all__ = [
    "ClutterConfig",
    "SceneConfig",
    "ShardSet",
    "SynthConfig",
    "TrainingSample",
    "read_sample",
    "write_dataset",
]
