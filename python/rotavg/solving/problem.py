"""A graph with what is known of its nodes: what the core solves, and the solution of that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rotavg import _core
from rotavg.base.arrays import read_only
from rotavg.base.errors import GraphError
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.priors.grounded import Grounded, ground
from rotavg.priors.priors import Priors, check_priors
from rotavg.priors.rigs import RigFit, Sensors, is_rigs, sensors_of
from rotavg.solving.certificate import certificate_from_core
from rotavg.solving.core_call import call_core
from rotavg.solving.robust import robust_from_core, with_named_priors
from rotavg.solving.solution import Solution
from rotavg.solving.status import Status, Timings, Trace


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be solved.

    Attributes:
        graph: the measurements.
        priors: as they were given.
        grounded: the measurements and the priors; None without, and where rigs are given by their
            sensors.
        eased: the same as the core solves it.
        sensors: those rigs, with all other priors.
    """

    graph: MeasurementGraph
    priors: Priors | None
    grounded: Grounded | None
    eased: Grounded | None
    sensors: Sensors | None

    @classmethod
    def of(cls, graph: MeasurementGraph, priors: Priors | None) -> Problem:
        """GraphError for priors that do not fit the graph."""
        if priors is not None:
            check_priors(priors)
        if priors is not None and is_rigs(priors):
            return cls(graph, priors, None, None, sensors_of(graph, priors))
        grounded = None if priors is None else ground(graph, priors)
        return cls(graph, priors, grounded, grounded and grounded.eased(), None)

    def solve(self, settings: dict[str, Any], *, start_is_solution: bool) -> dict[str, Any]:
        """What the core finds.

        Args:
            settings: the options, checked, by their names in the core.
            start_is_solution: whether the start that they hold is that of a warm start.
        """
        eased, sensors = self.eased, self.sensors
        try:
            return call_core(
                self.graph,
                _core.solve,
                **settings,
                priors=None if eased is None else eased.core,
                start_is_solution=start_is_solution,
                rigs=None if sensors is None else sensors.core,
                rig_priors=None if sensors is None else sensors.others,
            )
        except _core.InvalidPrior as error:
            assert sensors is not None
            raise sensors.error(error) from None
        except ValueError as error:
            ours = "all edges are between", "the rotations of all nodes are"
            if not str(error).startswith(ours):
                raise  # what a callback raises is the caller's
            raise GraphError(str(error)) from None

    def solution(
        self, core: dict[str, Any], origin: str | None, certificate_tolerance: float
    ) -> Solution:
        """The solution of what the core has found.

        Args:
            core: that.
            origin: what it started from; None for the initial value that the core names.
            certificate_tolerance: the largest relative gap that is called optimal.
        """
        rigs = self._rigs(core)
        grounded = self.grounded
        if rigs is not None and self.sensors is not None:
            grounded = self.sensors.grounded(rigs)
        robust = None
        if "robust" in core:
            robust = robust_from_core(core["robust"], self.graph)
            if self.priors is not None and grounded is not None:
                used = None if self.eased is None else self.eased.weights[0]
                robust = with_named_priors(robust, self.graph, self.priors, used)
                fits = robust.absolute_priors, robust.gravity_priors
                grounded = grounded.with_prior_weights(
                    *(None if f is None else f.believed_weights for f in fits)
                )
        return Solution(
            graph=self.graph,
            rotations=read_only(core["rotations"]),
            objective=core["objective"],
            gradient_norm=core["gradient_norm"],
            relative_gradient=core["relative_gradient"],
            status=Status[core["status"].upper()],
            iterations=core["iterations"],
            method=core["method"],
            reason=core["reason"],
            init=origin or core["init"],
            trace=Trace(**{name: read_only(values) for name, values in core["trace"].items()}),
            timings=Timings(**core["seconds"]),
            certificate=certificate_from_core(core["certificate"], certificate_tolerance),
            component=read_only(core["component"]),
            robust=robust,
            grounded=grounded,
            rigs=rigs,
        )

    def _rigs(self, core: dict[str, Any]) -> RigFit | None:
        """What was found of the sensors."""
        if self.sensors is None:
            return None
        weights = core["robust"]["edge_weights"] if "robust" in core else self.graph.weights
        return self.sensors.fit(core["rigs"], core["rotations"], core["objective"], weights)
