import dataclasses

import pytest

from bokehnet.cli.app import run
from bokehnet.config import load_config
from bokehnet.errors import ParameterError
from bokehnet.synth import ShardSet, SynthConfig, write_dataset

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'bokehnet[cluster]'")


@pytest.mark.slow
def test_set_made_while_a_worker_is_killed_is_that_of_one_machine(cluster, tmp_path):
    """Authority: the bytes that a single process writes for the same seed."""
    config = load_config("configs/synth_tiny.toml", SynthConfig)
    config = dataclasses.replace(config, scenes=8, scenes_per_shard=2, bokeh_samples=16)
    worker = cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    killed = []

    def kill(done, total):
        if done == 3 and not killed:
            assert len([node for node in ray.nodes() if node["Alive"]]) == 2
            cluster.remove_node(worker, allow_graceful=False)
            killed.append(done)

    write_dataset(config, tmp_path / "cluster", progress=kill, cluster=cluster.address)
    assert killed
    write_dataset(config, tmp_path / "alone")
    names = sorted(path.name for path in (tmp_path / "alone").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "cluster").iterdir())
    assert len(names) == 5
    for name in names:
        assert (tmp_path / "cluster" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    assert len(ShardSet(tmp_path / "cluster")) == 8


@pytest.mark.slow
def test_errors_of_a_scene_and_of_the_cluster_are_reported_in_one_line(start_cluster, tmp_path):
    config = load_config("configs/synth_tiny.toml", SynthConfig)
    with start_cluster(0) as cluster:
        with pytest.raises(ParameterError, match="workers with cores"):
            write_dataset(config, tmp_path / "none", cluster=cluster.address)
        cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        scene = dataclasses.replace(config.scene, photographs=("nothing",))
        with pytest.raises(ParameterError, match=r"photographs: .*got 'nothing'"):
            write_dataset(dataclasses.replace(config, scene=scene), tmp_path / "bad", cluster=cluster.address)


@pytest.mark.slow
@pytest.mark.parametrize("address", ["127.0.0.1:1", "ray://127.0.0.1:1", "nowhere", "127.0.0.1:many"])
def test_address_without_a_cluster_is_refused_at_once(address, tmp_path):
    config = load_config("configs/synth_tiny.toml", SynthConfig)
    with pytest.raises(ParameterError, match=f"running cluster, got '{address}'"):
        write_dataset(config, tmp_path, cluster=address)
    assert not any(tmp_path.glob("*.tar"))


@pytest.mark.slow
def test_command_line_passes_the_address_on(tmp_path, capsys):
    config, out = "configs/synth_tiny.toml", str(tmp_path)
    assert run(["synth", "--config", config, "--out", out, "--ray", "127.0.0.1:1"]) == 1
    message = capsys.readouterr().err
    assert "expected the address of a running cluster, got '127.0.0.1:1'" in message
    assert "Traceback" not in message
