"""What `cablecast aim` and `cablecast check` do and print for strikes in the air."""

from typing import Any

import numpy as np

from cablecast.aiming.config import AimConfig
from cablecast.aiming.strike import OUT_OF_REACH
from cablecast.aiming.strike_session import check_reach, nearest_point
from cablecast.cli.options import EXIT_FALLS_SHORT, open_rig
from cablecast.cli.progress import console_progress
from cablecast.cli.tries import StrikeTries, print_folder
from cablecast.conventions import Array
from cablecast.errors import InputError, TargetError
from cablecast.pipeline.aim import REPORT_FOLDER, check_folder
from cablecast.pipeline.strike import check_strike, prepare_strike, write_strike_report
from cablecast.report.strike_page import STRIKE_PAGE, STRIKE_PICTURE, envelope_text
from cablecast.rigs.make import check_rig
from cablecast.rigs.swings import move_envelope
from cablecast.runs.places import STRIKE_FOLDER, cable_folder
from cablecast.setup import Setup


def strike_targets(options: Any) -> Array:
    """Return the targets of a command line: distance ahead and height [m], shape [target, 2]."""
    if options.target_xy:
        raise InputError(
            "a strike takes --target AHEAD HEIGHT, in the plane of the swing, not --target-xy"
        )
    return np.array(list(dict.fromkeys(options.target)), dtype=float).reshape(-1, 2)


def aim_strike(options: Any, setup: Setup) -> int:
    """Strike the targets of `aim`'s options, print every swing, and return the exit status."""
    for name in ("paper_targets", "casts", "params", "fit_all"):
        if getattr(options, name):
            raise InputError(f"--{name.replace('_', '-')} is for casts onto a table")
    if not options.target:
        raise InputError("a strike needs --target AHEAD HEIGHT, once or more")
    places = strike_targets(options)
    out = options.out or cable_folder(setup.cable.name) / STRIKE_FOLDER
    check_folder(out)
    check_rig(options.rig, setup)
    config = AimConfig.of(options)
    with open_rig(options.rig, setup, options.seed, out, options.time_limit) as rig:
        with console_progress() as progress:
            session = prepare_strike(rig, config, out=out, progress=progress)
        known = len(session.active_casts())
        swings = "1 swing" if known == 1 else f"{known or 'no'} swings"
        print(f"{swings} of {setup.cable.name} {'is' if known == 1 else 'are'} known")
        envelope = move_envelope(setup, session.prior.units)
        print(f"{envelope_text(*envelope)}: keep people and things out of it")
        chosen, refusals = np.ones(len(places), dtype=bool), []
        for number, goal in enumerate(session.goals(places)):
            try:
                check_reach(session.prior, goal, session.plane)
            except TargetError as error:
                # At what is farther off there is nothing to try.
                near = nearest_point(session.prior, goal.value)[0] <= OUT_OF_REACH
                chosen[number] = near and config.force
                refusals += [str(error)] * (not chosen[number])
                hint = " (--force swings all the same)"
                words = "; it swings all the same" if config.force else hint
                print(f"{error}{words * near}", flush=True)
        if not chosen.any():
            return EXIT_FALLS_SHORT
        tries = StrikeTries(session)
        result = tries.cast_at(rig, places[chosen])
        write_strike_report(result, rig, out / REPORT_FOLDER, refusals)
    tries.print_result(result, len(refusals))
    print_folder(out, (STRIKE_PICTURE, STRIKE_PAGE))
    return 0 if result.hit.all() and chosen.all() else EXIT_FALLS_SHORT


def check_strikes(options: Any, setup: Setup) -> int:
    """Print what swings pass, and whether targets are among it; return the exit status."""
    places = strike_targets(options)
    with console_progress() as progress:
        found = check_strike(setup, seed=options.seed, progress=progress)
    print(found.summary)
    print(envelope_text(*found.envelope))
    for place in places:
        print(f"target   {place[0]:.2f} m ahead, {place[1]:.2f} m high")
        print(f"         {found.words_at(place)}")
    return EXIT_FALLS_SHORT if any(found.refusal_at(place) for place in places) else 0
