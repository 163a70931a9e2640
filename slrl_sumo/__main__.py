"""`python -m slrl_sumo` is `slrl-sumo`."""


def main() -> None:
    """The command line; an interrupt while it is imported ends it like one during a command."""
    try:
        from slrl_sumo.cli import main as command_line
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    command_line()


if __name__ == "__main__":
    main()
