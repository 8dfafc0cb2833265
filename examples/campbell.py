# Choosing a rate: where driving lines meet modes, by the closed form of the linearised drive.
import microvib as mv

plan = mv.plan_rates("state-1", mv.rate_grid("0.01 deg/s", "0.1 deg/s", 60), (16, 64), limit="30 mN*m", linear=True)

for microsteps in plan.counts:
    met = [f"{one.line} on {one.mode}" for one in plan.resonances if one.microsteps == microsteps]
    print(f"{microsteps} microsteps: {', '.join(met) or 'no line meets a mode'}")
figure = mv.plot(plan)
figure.savefig("campbell.png")
