"""`python -m slrl_sumo` is `slrl-sumo`."""

from slrl_sumo.cli import main

main()
