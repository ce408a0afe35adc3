import dataclasses
import json

import numpy as np
import pytest
import torch

from readygo.common.errors import ConfigError
from readygo.services.animator.priormdm.checkpoint import files_digest, load_model
from readygo.services.animator.priormdm.network import NetworkShape
from tests.services.animator.priormdm.networks import ARGS, random_network


def save(folder, state):
    torch.save(state, folder / "model.pt")


def test_state_dict_of_the_released_layout_loads_bit_for_bit(release):
    _, config = release
    model = load_model(config)
    for name, value in random_network().state_dict().items():
        assert torch.equal(model.network.state_dict()[name], value), name
    assert model.diffusion_steps == 50
    assert not model.network.training
    assert model.mean.shape == model.std.shape == (263,)


@pytest.mark.parametrize("wrapper", ["model", "model_avg"])
def test_wrapped_state_text_encoder_and_lacking_tables_are_taken(release, wrapper):
    folder, config = release
    state = {name: value for name, value in random_network().state_dict().items() if not name.endswith(".pe")}
    save(folder, {wrapper: {**state, "clip_model.positional_embedding": torch.zeros(77, 512)}})
    network = load_model(config).network
    assert torch.equal(network.sequence_pos_encoder.pe, random_network().sequence_pos_encoder.pe)
    assert torch.equal(network.output_process.poseFinal.weight, state["output_process.poseFinal.weight"])


def test_missing_and_unknown_names_are_listed_in_one_line(release):
    folder, config = release
    state = random_network().state_dict()
    del state["embed_text.bias"], state["seqTransEncoder.layers.1.norm2.bias"]
    save(folder, {**state, "seqTransEncoder.layers.2.norm2.bias": torch.zeros(32)})
    with pytest.raises(ConfigError) as error:
        load_model(config)
    text = str(error.value)
    assert "missing embed_text.bias, seqTransEncoder.layers.1.norm2.bias" in text
    assert "unknown seqTransEncoder.layers.2.norm2.bias" in text
    assert "\n" not in text


def test_shapes_of_another_size_are_listed(release):
    folder, config = release
    (folder / "args.json").write_text(json.dumps({**ARGS, "latent_dim": 64}))
    with pytest.raises(ConfigError, match=r"embed_text.bias is \(32,\), must be \(64,\).*and \d+ more") as error:
        load_model(config)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"arch": "trans_dec"}, "runs models with arch = 'trans_enc'"),
        ({"dataset": "babel"}, "dataset = 'babel'"),
        ({"noise_schedule": "linear"}, "noise_schedule"),
        ({"diffusion_steps": 0}, r"within 1\.\.4999"),
        ({"latent_dim": 30}, "multiple of num_heads"),
        ({"layers": "many"}, "args.json"),
    ],
)
def test_args_of_other_models_are_refused(release, change, message):
    folder, config = release
    (folder / "args.json").write_text(json.dumps({**ARGS, **change}))
    with pytest.raises(ConfigError, match=message):
        load_model(config)


def test_args_without_what_is_needed_are_refused(release):
    folder, config = release
    (folder / "args.json").write_text("{}")
    with pytest.raises(ConfigError, match="lacks diffusion_steps, latent_dim, layers"):
        load_model(config)
    (folder / "args.json").write_text("layers: 8")
    with pytest.raises(ConfigError, match="is not JSON"):
        load_model(config)
    (folder / "args.json").unlink()
    with pytest.raises(ConfigError, match=r"args\.json that was released with the weights"):
        load_model(config)


def test_weights_that_are_no_plain_state_dict_are_refused(release):
    folder, config = release
    (folder / "model.pt").write_bytes(b"not a checkpoint")
    with pytest.raises(ConfigError, match="no plain state dict") as error:
        load_model(config)
    assert "\n" not in str(error.value)
    save(folder, random_network())
    with pytest.raises(ConfigError, match="no plain state dict"):
        load_model(config)
    save(folder, [torch.zeros(3)])
    with pytest.raises(ConfigError, match="holds a list"):
        load_model(config)


@pytest.mark.parametrize("name", ["weights", "mean", "std"])
def test_missing_files_are_named(release, name):
    folder, config = release
    with pytest.raises(ConfigError, match="absent"):
        load_model(dataclasses.replace(config, **{name: str(folder / "absent")}))
    with pytest.raises(ConfigError, match=rf"not set: priormdm\.{name};.*github\.com/priorMDM"):
        load_model(dataclasses.replace(config, **{name: ""}))


def test_statistics_of_another_layout_are_refused(release):
    folder, config = release
    np.save(folder / "Mean.npy", np.zeros(251))
    with pytest.raises(ConfigError, match="must hold 263 finite numbers"):
        load_model(config)
    np.save(folder / "Mean.npy", np.zeros(263))
    np.save(folder / "Std.npy", np.zeros(263))
    with pytest.raises(ConfigError, match="must be positive"):
        load_model(config)


def test_digest_of_a_run_refuses_other_files(release):
    folder, config = release
    pinned = dataclasses.replace(config, sha256=files_digest(config))
    load_model(pinned)
    np.save(folder / "Std.npy", np.full(263, 0.5, np.float32))
    with pytest.raises(ConfigError, match="are others than the run's"):
        load_model(pinned)


def test_digest_of_a_run_covers_the_pose_prior(release):
    folder, config = release
    (folder / "gmm_08.pkl").write_bytes(b"one")
    config = dataclasses.replace(config, refine="prior", pose_prior=str(folder / "gmm_08.pkl"))
    first = files_digest(config)
    (folder / "gmm_08.pkl").write_bytes(b"two")
    assert len({first, files_digest(config), files_digest(release[1])}) == 3


def test_sizes_that_args_leave_out_are_those_of_the_release(release):
    folder, config = release
    shape = NetworkShape(layers=1, latent_dim=32, ff_size=1024, num_heads=4)
    save(folder, random_network(shape).state_dict())
    (folder / "args.json").write_text(json.dumps({"layers": 1, "latent_dim": 32, "diffusion_steps": 4999}))
    model = load_model(config)
    assert (model.diffusion_steps, model.sigma_small, model.mask_frames, model.text) == (4999, True, False, None)
    for steps in (0, 5000, 7.5):
        (folder / "args.json").write_text(json.dumps({"layers": 1, "latent_dim": 32, "diffusion_steps": steps}))
        with pytest.raises(ConfigError, match=r"within 1\.\.4999"):
            load_model(config)
