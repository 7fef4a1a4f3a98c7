"""Pressures in a town's water network while a hydrant flows: the network Net1 that WNTR brings."""

import wntr

network = wntr.network.WaterNetworkModel("Net1")
network.options.time.duration = 0  # one moment
pipes = [pipe for _, pipe in network.pipes()]
network.get_node("32").add_demand(0.0, None)
hydrant = network.get_node("32").demand_timeseries_list[1]


def pressures(flow, demand, roughness):
    """Pressure (m of water) at the hydrant and at the junction north of it.

    The hydrant flows `flow` (L/s); the town takes `demand` times its nominal demand. `roughness` is
    the coefficient of Hazen and Williams of all pipes.
    """
    network.reset_initial_values()
    network.options.hydraulic.demand_multiplier = demand
    hydrant.base_value = 1e-3 * flow / demand  # the multiplier is for all demands
    for pipe in pipes:
        pipe.roughness = roughness
    found = wntr.sim.WNTRSimulator(network).run_sim().node["pressure"].iloc[0]
    return {"at_hydrant": float(found["32"]), "at_junction": float(found["31"])}
