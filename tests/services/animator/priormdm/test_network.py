import pytest
import torch

from readygo.services.animator.priormdm.network import Mdm, NetworkShape
from tests.services.animator.priormdm.networks import SMALL, random_network


def test_released_size_has_the_released_names_and_shapes():
    with torch.device("meta"):
        state = Mdm(NetworkShape()).state_dict()
    shapes = {name: tuple(value.shape) for name, value in state.items()}
    expected = {
        "input_process.poseEmbedding.weight": (512, 263),
        "input_process.poseEmbedding.bias": (512,),
        "sequence_pos_encoder.pe": (5000, 1, 512),
        "embed_timestep.sequence_pos_encoder.pe": (5000, 1, 512),
        "embed_timestep.time_embed.0.weight": (512, 512),
        "embed_timestep.time_embed.0.bias": (512,),
        "embed_timestep.time_embed.2.weight": (512, 512),
        "embed_timestep.time_embed.2.bias": (512,),
        "embed_text.weight": (512, 512),
        "embed_text.bias": (512,),
        "output_process.poseFinal.weight": (263, 512),
        "output_process.poseFinal.bias": (263,),
    }
    layer = {
        "self_attn.in_proj_weight": (1536, 512),
        "self_attn.in_proj_bias": (1536,),
        "self_attn.out_proj.weight": (512, 512),
        "self_attn.out_proj.bias": (512,),
        "linear1.weight": (1024, 512),
        "linear1.bias": (1024,),
        "linear2.weight": (512, 1024),
        "linear2.bias": (512,),
        "norm1.weight": (512,),
        "norm1.bias": (512,),
        "norm2.weight": (512,),
        "norm2.bias": (512,),
    }
    for i in range(8):
        expected |= {f"seqTransEncoder.layers.{i}.{name}": shape for name, shape in layer.items()}
    assert shapes == expected
    assert len(shapes) == 108


def test_encoder_agrees_with_torchs_own():
    network = random_network()
    oracle = torch.nn.TransformerEncoder(
        torch.nn.TransformerEncoderLayer(32, 4, 48, 0.1, activation="gelu", batch_first=True),
        2,
        enable_nested_tensor=False,
    ).eval()
    oracle.load_state_dict(network.seqTransEncoder.state_dict())
    x = torch.randn(3, 20, 32, generator=torch.Generator().manual_seed(0))
    attends = torch.ones(3, 20, dtype=torch.bool)
    attends[1, 12:] = False
    with torch.no_grad():
        assert torch.allclose(network.seqTransEncoder(x, None), oracle(x), atol=1e-5)
        ours, theirs = network.seqTransEncoder(x, attends), oracle(x, src_key_padding_mask=~attends)
    assert torch.allclose(ours[1, :12], theirs[1, :12], atol=1e-5)


def test_padding_does_not_reach_other_frames():
    network = random_network()
    x = torch.randn(2, 30, 263, generator=torch.Generator().manual_seed(1))
    valid = torch.ones(2, 30, dtype=torch.bool)
    valid[:, 21:] = False
    other = x.clone()
    other[:, 21:] = 50.0
    step = torch.tensor([3, 17])
    a, b = network(x, step, None, valid), network(other, step, None, valid)
    assert torch.equal(a[:, :21], b[:, :21])
    assert torch.allclose(a[:, :21], network(x[:, :21], step), atol=1e-5)
    assert not torch.allclose(network(x, step)[:, :21], network(other, step)[:, :21], atol=1e-3)


def test_motions_of_a_batch_do_not_mix_and_steps_and_texts_matter():
    network = random_network()
    x = torch.randn(2, 16, 263, generator=torch.Generator().manual_seed(2))
    step = torch.tensor([4, 40])
    text = torch.randn(2, 512, generator=torch.Generator().manual_seed(3))
    both = network(x, step, text)
    assert torch.allclose(both[1:], network(x[1:], step[1:], text[1:]), atol=1e-5)
    assert not torch.allclose(both[1:], network(x[1:], step[:1], text[1:]), atol=1e-3)
    assert not torch.allclose(both, network(x, step), atol=1e-3)


def test_no_text_is_the_text_of_zeros():
    network = random_network()
    x = torch.randn(1, 8, 263, generator=torch.Generator().manual_seed(2))
    step = torch.tensor([4])
    assert torch.equal(network(x, step), network(x, step, torch.zeros(1, 512)))
    assert "embed_text.weight" not in random_network(NetworkShape(layers=1, latent_dim=8, text=False)).state_dict()


def test_frames_know_their_place():
    network = random_network(SMALL)
    x = torch.zeros(1, 8, 263)
    y = network(x, torch.tensor([0]))
    assert not torch.allclose(y[0, 0], y[0, 5], atol=1e-3)


def test_sizes_that_do_not_divide_are_refused():
    with pytest.raises(ValueError, match="multiple of num_heads"):
        NetworkShape(latent_dim=30, num_heads=4)
