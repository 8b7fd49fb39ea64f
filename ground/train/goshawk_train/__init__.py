"""Trains Goshawk's policies (paper section III-E): network, costs, data loading, trainer, export."""
