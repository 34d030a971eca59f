"""Parts of bench/window.py and bench/motion_bench_maker.py."""
