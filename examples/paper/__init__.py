"""The experiments of Mengacci et al. (2021): a file for each figure, which `asrsim reproduce` runs, and what they measure by.

Whoever has a copy (`asrsim examples`) may change a figure or write one: a file `figure_N.py` with a `FIGURE`.
"""
