import os

import torch

from readygo.services.trainer import TrainConfig
from readygo.services.trainer.hardware import available_cores, cpu_has_bf16, dtype_of

CPU = torch.device("cpu")


def test_precision_that_is_asked_for_is_taken():
    assert dtype_of(TrainConfig(precision="bf16"), CPU) is torch.bfloat16
    assert dtype_of(TrainConfig(precision="fp32"), CPU) is torch.float32
    assert dtype_of(TrainConfig(), torch.device("cuda")) is torch.bfloat16


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


def test_cores_are_those_of_this_process():
    assert 1 <= available_cores() <= (os.cpu_count() or 1)
