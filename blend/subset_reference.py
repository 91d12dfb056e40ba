"""Renders replicas of a reference that are disjoint subsets of one sequence of samples.

Request and result: as reference.py with "replicas", each of which has "subset": [first sample, number of
samples]; the request's "samples" are those of the whole sequence. Replicas by seed share what Cycles draws
by the number of a sample alone (docs/findings), so that their spread does not show it; that of subsets does.
"""

import protocol


def handle(request, messages):
    """Build the scene of the request, render its subsets, and write an EXR of each."""
    import reference_render

    # The texts of the other scripts are part of what references are known by in caches: they stay.
    apply_whole = reference_render.apply_request
    subsets = iter([replica["subset"] for replica in request["replicas"]])

    def apply_subset(target, asked, seed):
        settings = apply_whole(target, asked, seed)
        offset, length = next(subsets)
        target.cycles.use_sample_subset = True
        target.cycles.sample_offset, target.cycles.sample_subset_length = offset, length
        return settings | {
            "samples": length,
            "sample_offset": offset,
            "samples_of_sequence": asked["samples"],
        }

    reference_render.apply_request = apply_subset
    return reference_render.render_reference(request, messages)


if __name__ == "__main__":
    protocol.serve("subset_reference.py", handle)
