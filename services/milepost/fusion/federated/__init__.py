"""Federated fusion: each local filter keeps a share of the information, and the fused state is their weighted sum."""
