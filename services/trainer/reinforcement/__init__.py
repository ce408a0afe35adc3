"""Reinforcement learning of a state policy by PPO, in the state simulation. All but `config` needs torch."""
