"""Run-time of an exported policy."""

from readygo.common.policy.artifact import PolicySpec, load_spec, save_spec
from readygo.common.policy.memory import PolicyMemory
from readygo.common.policy.onnx_policy import load_policy
from readygo.common.policy.policy import Policy, check_policy_camera, check_policy_limits

__all__ = [
    "Policy",
    "PolicyMemory",
    "PolicySpec",
    "check_policy_camera",
    "check_policy_limits",
    "load_policy",
    "load_spec",
    "save_spec",
]
