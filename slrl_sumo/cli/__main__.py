"""`python -m slrl_sumo.cli` is `slrl-sumo`."""

from slrl_sumo.cli import main

main()
