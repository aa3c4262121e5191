"""From the first cast on a robot to casts at targets: the whole way, on the virtual rig."""

import cablecast as cc

setup = cc.Setup(cable="cable_1")
with cc.make_rig("virtual", setup, seed=0) as rig:
    casts = cc.collect(rig, count=5)
    tuned = cc.tune(casts)
    policy = cc.train(cc.simulate(setup, tuned, count=4000), epochs=30)
    plan = policy.plan(r=1.10, theta_deg=16.7)
    print(plan)
    print(cc.evaluate(policy, rig).summary)
