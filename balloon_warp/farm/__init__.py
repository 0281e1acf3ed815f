"""Farm: a batch or a gradient on many workers, GPUs or processes of this machine, or a Dask cluster.

Read `workers` first, what a worker is, and those of this machine; then `cluster`, how shares of work go out and come
back, and a batch cut into shares, whose files are written in one place. The core knows a cluster as a `BatchPlace`
alone.
"""
