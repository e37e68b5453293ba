"""Experiments of Mengacci et al. (2021): one file for each figure, and the models that the figures are compared with.

`asrsim reproduce` runs them. To change a figure, copy the files with `asrsim examples`. A new figure is a file
`figure_N.py` that defines `FIGURE`.
"""
