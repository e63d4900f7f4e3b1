"""A blade breaks, the detector names it, a picture: needs `pip install rotortwin-….whl pandas matplotlib`, and no server."""

import rotortwin

fault = {"time_s": 12.0, "rotor": 4, "thrust_loss_percent": 8.0}
flight = rotortwin.Simulation("hover", seed=7, set={"duration_s": 20.0, "fault": [fault]}).run()
print(flight.verdict)

seen = flight.frame().query("verdict_sequential == 4")
print(f"named after {seen.time_s.iloc[0] - fault['time_s']:.2f} s")
flight.plot().savefig("damaged-blade.png")
