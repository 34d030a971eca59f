"""What `bench/planning.py` is made of: seeded scenes, bounds, planners, a judge, and tables."""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is loaded: CPU time is counted over all threads
