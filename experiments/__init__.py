"""Experiments: programs that answered a question once, kept so that their numbers can be shown again.

They are run from a checkout (`python -m experiments.policy.given_state SCENE`) and are no part of the wheel.
"""
