"""Strike points in the air with a cable that nobody fitted, on the strike laboratory.

The cable hangs from a stick in a UR5's hand. Nothing is known of it but its file: the laboratory
has another copy of it, in MuJoCo, and a camera next to the plane of the swing.
"""

import pathlib

import cablecast as cc

# Distance ahead of the robot's base, and height [m].
TARGETS = [[1.2, 0.9], [1.0, 1.3]]


def main(
    move_count: int | None = None,
    cable_count: int | None = None,
    tries: int = 4,
    out: pathlib.Path = pathlib.Path("runs/strike"),
) -> None:
    setup = cc.Setup(cable="cable_1", strike=cc.StrikeConfig(stick_length=0.5, watch_time=2.0))
    with cc.make_rig("virtual", setup) as rig:
        session = cc.prepare_strike(
            rig, cc.AimConfig(tries=tries), out=out, move_count=move_count, cable_count=cable_count
        )
        result = cc.aim(session, rig, TARGETS)
    for target, casts in zip(TARGETS, result.casts, strict=True):
        for cast in casts:
            miss = cast.miss_pct * setup.cable.length
            print(f"{target}, try {cast.try_number}: {cast.action}: {miss:.1f} cm off")
    print(f"{result.hit.sum()} of {len(TARGETS)} targets were struck")


if __name__ == "__main__":
    main()
