"""What `cablecast aim` and `cablecast check` do and print for strikes in the air."""

import os
from typing import TYPE_CHECKING, Any

from cablecast.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cablecast.aiming.strike_session import StrikeSession
    from cablecast.cast import Cast, Proposal
    from cablecast.motion.joint_move import SwingPlane
    from cablecast.pipeline.aim import AimResult
    from cablecast.setup import Setup

EXIT_MISSED = 3


def strike_targets(options: Any) -> "NDArray[np.float64]":
    """Return the targets of a command line: distance ahead and height [m], shape [target, 2]."""
    import numpy as np

    if options.target_xy:
        raise InputError(
            "a strike takes --target AHEAD HEIGHT, in the plane of the swing, not --target-xy"
        )
    return np.array(options.target, dtype=float).reshape(-1, 2)


def aim_strike(options: Any, setup: "Setup") -> int:
    """Strike the targets of `aim`'s options, print every swing, and return the exit status."""
    import numpy as np

    from cablecast.aiming.config import AimConfig
    from cablecast.aiming.strike_session import check_reach
    from cablecast.cli.options import open_rig
    from cablecast.cli.progress import console_progress
    from cablecast.errors import TargetError
    from cablecast.pipeline.aim import REPORT_FOLDER, aim, check_folder
    from cablecast.pipeline.strike import prepare_strike, write_strike_report
    from cablecast.report.strike_page import STRIKE_PAGE, STRIKE_PICTURE
    from cablecast.rigs.make import check_rig
    from cablecast.rigs.swings import move_envelope
    from cablecast.runs.places import STRIKE_FOLDER, cable_folder
    from cablecast.runs.progress import ignore

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
        known = len(session.casts)
        swings = "1 swing" if known == 1 else f"{known or 'no'} swings"
        print(f"{swings} of {setup.cable.name} {'is' if known == 1 else 'are'} known")
        envelope = move_envelope(setup, session.prior.units)
        print(f"{envelope_text(*envelope)}: keep people and things out of it")
        chosen = np.ones(len(places), dtype=bool)
        for number, goal in enumerate(session.goals(places)):
            try:
                check_reach(session.prior, goal, session.plane)
            except TargetError as error:
                chosen[number] = config.force
                print(f"{error} (--force swings all the same)", flush=True)
        if not chosen.any():
            return EXIT_MISSED
        result = aim(
            session,
            rig,
            places[chosen],
            on_proposal=lambda proposal: print_proposal(proposal, session),
            on_cast=lambda cast: print_cast(cast, session),
            progress=ignore,
        )
        write_strike_report(result, rig, out / REPORT_FOLDER)
    print_result(result, session.plane)
    print(f"folder    {out}")
    print(f"picture   {os.path.join(out, REPORT_FOLDER, STRIKE_PICTURE)}")
    print(f"report    {os.path.join(out, REPORT_FOLDER, STRIKE_PAGE)}")
    return 0 if result.hit.all() and chosen.all() else EXIT_MISSED


def envelope_text(low: "NDArray[np.float64]", high: "NDArray[np.float64]") -> str:
    """Return where the cable can be in any swing, from the corners of a box [m], shape [3]."""
    sides = (f"{a} {low[k]:.2f} to {high[k]:.2f} m" for k, a in enumerate("xyz"))
    return f"the cable can be anywhere in {', '.join(sides)}"


def print_proposal(proposal: "Proposal", session: "StrikeSession") -> None:
    """Say what a swing is expected to do."""
    from cablecast.report.strike_page import place_text
    from cablecast.report.words import chance_text, distance_text

    if proposal.try_number == 1:
        print(f"\ntarget    {place_text(proposal.goal.value, session.plane)}")
    print(f"try {proposal.try_number}     {proposal.action}, {proposal.trajectory.duration:.2f} s")
    print(f"  expect  a hit with a chance of {chance_text(proposal.hit_chance)}")
    print(f"          {distance_text(proposal)}", flush=True)


def print_cast(cast: "Cast", session: "StrikeSession") -> None:
    """Say what a swing did."""
    import numpy as np

    from cablecast.report.strike_page import place_text

    if not np.isfinite(cast.miss_pct):
        print(f"  saw     {cast.status.value.partition(':')[0].rstrip('.').lower()}")
        return
    verdict = "hit" if cast.hit else "missed"
    centimetres = cast.miss_pct * session.setup.cable.length
    print(f"  saw     the tip pass {place_text(cast.outcome, session.plane)}")
    print(f"          {verdict}: {centimetres:.1f} cm off, {cast.miss_pct:.1f} % of the cable")


def print_result(result: "AimResult", plane: "SwingPlane") -> None:
    """Print one line per target, and how many were hit."""
    from cablecast.cli import tables
    from cablecast.report.strike_page import place_text
    from cablecast.report.words import verdict_text

    tries = max((len(casts) for casts in result.casts), default=0)
    heads = ("target", *(str(number) for number in range(1, tries + 1)))
    table = tables.make_table("Closest point of each try, in cm", *heads)
    length = result.session.setup.cable.length
    for target, casts in zip(result.target_xy, result.casts, strict=True):
        cells = [f"{cast.miss_pct * length:.1f}" for cast in casts]
        style = "bold" if any(cast.hit for cast in casts) else ""
        table.add_row(place_text(target, plane), *cells, *[""] * (tries - len(cells)), style=style)
    tables.print_table(table, f"{verdict_text(result.casts)}.")


def check_strikes(options: Any, setup: "Setup") -> int:
    """Print what swings pass, and whether targets are among it; return the exit status."""
    from cablecast.cli.progress import console_progress
    from cablecast.pipeline.strike import check_strike

    places = strike_targets(options)
    with console_progress() as progress:
        found = check_strike(setup, seed=options.seed, progress=progress)
    print(found.summary)
    print(envelope_text(*found.envelope))
    for place in places:
        print(f"target   {place[0]:.2f} m ahead, {place[1]:.2f} m high")
        print(f"         {found.words_at(place)}")
    return EXIT_MISSED if any(found.refusal_at(place) for place in places) else 0
