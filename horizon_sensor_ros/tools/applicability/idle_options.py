"""Options that a mode of `horizon_applicability` makes no use of: given with it they are mistakes.

Options that count in some modes alone have no default, so that it shows whether they were given.
"""

from __future__ import annotations

import argparse

from horizon_sensor_ros.tools.command import is_given

_QUESTIONS = ("--quality", "--mounting", "--figure6")
_OF_THE_FIELD = ("--min-arc", "--any", "--error", "--trials")
_OF_A_MAP = ("--axes", "--range", "--y-range", "--step", "--altitude")
_IDLE = {
    "--quality": (*_OF_THE_FIELD, "--tilt"),
    "--mounting": (*_OF_A_MAP, *_OF_THE_FIELD),
    "--figure6": ("--cameras", "--sigma", *_OF_THE_FIELD, "--tilt"),
}
DEFAULTS = {"range": (-90.0, 90.0), "step": 1.0, "min_arc": 0.0, "sigma": 0.1, "trials": 0}


def idle_option(args: argparse.Namespace) -> str:
    """What is wrong with the options that were given together, for a person; empty where nothing
    is.
    """
    asked = [question for question in _QUESTIONS if is_given(args, question)]
    if len(asked) > 1:
        return f"{' and '.join(asked)} are several questions; ask one of them"
    for question in asked:
        for option in _IDLE[question]:
            if is_given(args, option):
                return f"{option} has no effect with {question}; leave one of them out"
    if asked:
        return ""
    if args.tilt is not None:
        return "--tilt is asked of --mounting alone"
    if args.trials is not None and args.error in (None, "bound"):
        return "--trials has no effect without --error METHOD, which is tried so often"
    if args.sigma is not None and not (args.error == "bound" or args.trials):
        return (
            "--sigma has no effect without --error bound, or --error METHOD with --trials, whose "
            "noise it is"
        )
    return ""
