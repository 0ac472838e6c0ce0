"""The herdability map as a figure: χ by dogs and √M, a panel for each shepherd."""

import numpy as np
from matplotlib.figure import Figure

from skydog.study import herdability
from skydog.study.herdability import MAP_DOGS, MAP_RUNS, MAP_STEPS, OURS, PUBLISHED, RULE
from skydog.study.options import Results
from skydog.view.style import drawing

TITLES = {RULE: "rule of Lama & di Bernardo", OURS: "ring"}


def chart(results: Results) -> Figure:
    """The map of `skydog reproduce --herdability`, and on it each shepherd's threshold."""
    sheep = [row["sheep"] for row in results["rows"]]
    roots = [f"{np.sqrt(many):g}" for many in sheep]
    with drawing():
        figure = Figure(figsize=(6.8, 3.6), layout="constrained")
        panels = figure.subplots(1, len(TITLES), sharey=True)
        images = []
        for axes, (name, title) in zip(panels, TITLES.items(), strict=True):
            image = axes.imshow(
                results["map"][name],
                origin="lower",
                aspect="auto",
                vmin=0.0,
                vmax=1.0,
                cmap="cividis",
                extent=(-0.5, len(sheep) - 0.5, MAP_DOGS[0] - 1, MAP_DOGS[-1] + 1),
            )
            images.append(image)
            at = np.arange(len(sheep))
            axes.plot(
                at,
                [row[name]["fewest"] for row in results["rows"]],
                *("o-",),
                color="white",
                markeredgecolor="black",
                label="fewest dogs for χ ≥ 0.99, measured",
            )
            for (published, (a, b)), dashes in zip(PUBLISHED.items(), ("--", ":"), strict=True):
                axes.plot(
                    at,
                    [a * np.sqrt(many) + b for many in sheep],
                    dashes,
                    color="#D55E00",
                    label=f"published, {published}: {a:.2f} √M − {-b:.2f}",
                )
            axes.set_title(title, loc="left")
            axes.set_xticks(at, roots)
            axes.set_xlabel("√M, of M sheep")
        panels[0].set_ylabel("dogs N")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        seconds = MAP_STEPS * herdability.DT
        figure.colorbar(
            images[0], ax=panels, label=f"χ within {seconds:g} s, mean of {MAP_RUNS} runs"
        )
    return figure
