"""The optimiser of `cloudparity tune`: CMA-ES (pycma) in the unit cube, and the error that it lowers.

A conversation (see protocol.py). Requests by `op`:

  start    `dimensions`, `initial` (in the unit cube), `deviation`, `seed`, `population`: begins a search.
  ask      `{}`: the candidates of a generation, each a point of the unit cube.
  tell     `candidates`, `objectives`: their errors. Result: `stop`, the reasons to stop, and `best`.
  truths   `views`: a list of files of replicas per view, read once.
  flip     `pictures`: lists [view, EXR file]; mean HDR-FLIP of each against the mean of the view's replicas.
  expose   `pictures`: lists [view, EXR at exposure 0, EXR at exposure 1]: the `exposure` at which the mean
           HDR-FLIP is least, and that `flip`. Pictures are linear in it.
  noise    `pairs`: lists of two lists of files: mean HDR-FLIP between the means of either.

The same seed and the same objectives give the same candidates: a search is resumed by telling it again.
"""

import numpy as np

import image_metrics
import protocol

FURTHEST_EXPOSURE = 4.0  # and its inverse, of what a match may be
BLOCK = 16  # of image_metrics' local means, which are not used here


class Session:
    """The state of a conversation."""

    def __init__(self):
        self._strategy = None
        self._dimensions = 0
        self._asked = []
        self._truths = []

    def answer(self, request, messages):
        """Answer one request."""
        operations = {
            "start": self._start,
            "ask": self._ask,
            "tell": self._tell,
            "truths": self._read_truths,
            "flip": self._flip,
            "expose": self._expose,
            "noise": _noise,
        }
        if request["op"] not in operations:
            raise protocol.InputError(
                "request.op", repr(request["op"]), f"one of {', '.join(operations)}", "correct the request"
            )
        return operations[request["op"]](request)

    def _start(self, request):
        try:
            import cma
        except ImportError as error:
            raise protocol.InputError(
                "Python package cma", str(error), "the optimiser's library", "run `make setup`"
            ) from None
        options = {
            "bounds": [0.0, 1.0],
            "seed": int(request["seed"]),
            "popsize": int(request["population"]),
            "verbose": -9,
        }
        initial = list(request["initial"])
        # The library searches in two dimensions at least: a single parameter has one beside it that nothing
        # depends on.
        self._dimensions = len(initial)
        if self._dimensions == 1:
            initial.append(0.5)
        self._strategy = cma.CMAEvolutionStrategy(initial, request["deviation"], options)
        return {"library": f"pycma {cma.__version__.split()[0]}"}

    def _ask(self, request):
        self._asked = self._strategy.ask()
        return {"candidates": [list(map(float, candidate[: self._dimensions])) for candidate in self._asked]}

    def _tell(self, request):
        candidates = [np.array(candidate, float) for candidate in request["candidates"]]
        if self._dimensions == 1:
            both = zip(candidates, self._asked, strict=True)
            candidates = [np.append(told, asked[1]) for told, asked in both]
        self._strategy.tell(candidates, list(request["objectives"]))
        return {"stop": sorted(self._strategy.stop())}

    def _read_truths(self, request):
        self._truths = [read_mean(files) for files in request["views"]]
        return {}

    def _flip(self, request):
        return {
            "means": [_error(read_mean([file]), self._truths[view]) for view, file in request["pictures"]]
        }

    def _expose(self, request):
        from scipy import optimize

        parts = [(read_mean([dark]), read_mean([lit]), view) for view, dark, lit in request["pictures"]]

        def error(logarithm):
            exposure = np.exp(logarithm)
            pictures = [(dark + exposure * (lit - dark), view) for dark, lit, view in parts]
            return np.mean([_error(picture, self._truths[view]) for picture, view in pictures])

        limit = np.log(FURTHEST_EXPOSURE)
        found = optimize.minimize_scalar(
            error, bounds=(-limit, limit), method="bounded", options={"xatol": 1e-2}
        )
        return {"exposure": float(np.exp(found.x)), "flip": float(found.fun)}


def _noise(request):
    return {"means": [_error(read_mean(one), read_mean(other)) for one, other in request["pairs"]]}


def _error(picture, truth):
    figures, _ = image_metrics.hdr_flip(picture, truth)
    if figures["mean"] is None:
        raise protocol.InputError(
            "HDR-FLIP", figures["why_not"], "a figure to lower", "install the packages, or light the scene"
        )
    return figures["mean"]


def read_mean(files):
    """The mean colour of replicas, scene-linear [h, w, 3]."""
    try:
        side = image_metrics.load_side(list(files), BLOCK)
    except image_metrics.Unreadable as error:
        raise protocol.InputError(
            "pictures", str(error), "readable scene-linear EXRs", "give others"
        ) from None
    return side.mean[..., side.indices("colour")]


if __name__ == "__main__":
    protocol.converse("optimiser.py", Session().answer)
