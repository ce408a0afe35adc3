import torch

from readygo.services.trainer import TrainConfig, hardware
from readygo.services.trainer.hardware import cpu_has_bf16, dtype_of

CPU = torch.device("cpu")
USUAL, SMALL = (72, 128), (24, 32)


def test_precision_that_is_asked_for_is_taken():
    assert dtype_of(TrainConfig(precision="bf16"), CPU, SMALL) is torch.bfloat16
    assert dtype_of(TrainConfig(precision="fp32"), CPU, USUAL) is torch.float32
    assert dtype_of(TrainConfig(), torch.device("cuda"), USUAL) is torch.bfloat16


def test_cpu_computes_in_halves_if_it_multiplies_them_and_images_are_not_tiny(monkeypatch):
    for has, size_px, expected in (
        (True, USUAL, torch.bfloat16),
        (True, SMALL, torch.float32),
        (False, USUAL, torch.float32),
    ):
        monkeypatch.setattr(hardware, "cpu_has_bf16", lambda has=has: has)
        assert dtype_of(TrainConfig(), CPU, size_px) is expected


def test_cpus_say_what_they_multiply(tmp_path):
    info = tmp_path / "cpuinfo"
    for line, has in (
        ("flags\t\t: fpu avx512f avx512_bf16 amx_tile", True),
        ("flags\t\t: fpu amx_bf16", True),
        ("flags\t\t: fpu avx512f avx2", False),
        ("Features\t: fp asimd bf16", True),
        ("model name\t: bf16", False),
    ):
        info.write_text(f"processor\t: 0\n{line}\n")
        assert cpu_has_bf16(info) is has
    assert not cpu_has_bf16(tmp_path / "nowhere")
