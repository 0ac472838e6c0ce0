"""Our side: the loop of `skydog train`, standing still between slices. Started by the benchmark."""

import sys

import slices

slices.pin(int(sys.argv[1]))

import equinox  # noqa: E402
import jax  # noqa: E402
import same_task  # noqa: E402

from skydog.learning import ddpg, train  # noqa: E402


class Slices:
    """Listens to the training: lets it run for the steps asked for, then holds it."""

    def __init__(self):
        self.asked = slices.requests()
        self.watch: slices.Watch | None = None
        self.began = self.until = 0

    def __call__(self, progress: train.Progress) -> bool:
        if progress.step < self.until:
            return True
        if self.watch is None:  # the first chunk is done: everything is compiled
            slices.answer(jax=jax.__version__, equinox=equinox.__version__)
        else:
            self.watch.answer(progress.step - self.began)
        request = next(self.asked, None)
        if request is None:
            return False
        self.began, self.until = progress.step, progress.step + request["steps"]
        self.watch = slices.Watch()
        return True


train.train(same_task.lesson(), ddpg.Config(), seed=0, steps=sys.maxsize, callback=Slices())
