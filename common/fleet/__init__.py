"""The fleet's protocol as its workers and recorders speak it; the coordinator answers."""

from readygo.common.fleet.append import append_episode
from readygo.common.fleet.leases import Inputs, StageResult, Work, Worker, claim_any, pull
from readygo.common.fleet.shown import show_plan

__all__ = ["Inputs", "StageResult", "Work", "Worker", "append_episode", "claim_any", "pull", "show_plan"]
