"""Random lines for the emulated unit."""

from __future__ import annotations

import hypothesis.strategies as st

NAMES = [
    "ECHO", "STAMP", "VER", "ST", "R", "RA", "RG", "APA", "APG", "APH", "GA", "GG", "SPDA", "SPDTB", "PWMA", "HHA",
    "HHG", "STOP", "STOPA", "RELEASE", "RELEASEG", "PURGE", "PURGEB", "REGMSA", "REGACCA", "REGMSG", "COORDGRP",
    "COORDDISCONT", "COORDISCONT", "COORDMV", "COORDMVT", "COORDRELMVT", "COORDSPLINET", "COORDAP", "IDLEREL",
]  # fmt: skip

numbers = st.one_of(
    st.integers(-(2**31), 2**31), st.integers(-100, 100), st.floats(), st.sampled_from(["", "A", "-", "1e9"])
)

lines = st.one_of(
    st.builds(
        lambda name, mark, values: name + mark + ",".join(map(str, values)),
        st.sampled_from(NAMES),
        st.sampled_from([":", "?", "?:", "", "::"]),
        st.lists(numbers, max_size=22),
    ),
    st.builds(
        lambda ms, order, rows: f"COORDSPLINET:{ms},{order}," + ",".join(map(str, rows[: 6 * order])),
        st.integers(0, 3000),
        st.integers(1, 4),
        st.lists(st.integers(-(2**31) + 1, 2**31 - 1), min_size=24, max_size=24),
    ),
    st.sampled_from(["COORDGRP:A,B,C,D,E,F", "REGMSA:2147483647", "REGACCA:2147483647", "SPDA:8388607"]),
    st.binary(max_size=40).map(lambda data: data.decode("latin-1")),
)
