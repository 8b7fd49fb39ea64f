"""Learned against classical pilot: cells that both flew on the same seeds, as one page and one verdict."""
