"""The episodes of an evaluation, generated instead of listed, because there may be millions."""

from collections.abc import Iterator
from dataclasses import dataclass

from slrl_sumo.studies.episodes.episode import Episode


@dataclass(frozen=True)
class EpisodePlan:
    """Every party (selector and number of agents) in every episode of every seed, in the order in which they are
    played: all cells of the table grow together, and seeds are finished one after the other."""

    parties: tuple[tuple[str, int], ...]
    seeds: range
    numbers: range

    def __len__(self) -> int:
        return len(self.seeds) * len(self.numbers) * len(self.parties)

    def __iter__(self) -> Iterator[Episode]:
        for seed in self.seeds:
            for number in self.numbers:
                for selector, agents in self.parties:
                    yield Episode(selector, agents, seed, number)

    def index(self, episode: Episode) -> int | None:
        """The place of an episode in the plan, from 0; None where it does not belong to it."""
        party = episode.selector, episode.agents
        if party not in self.parties or episode.seed not in self.seeds or episode.number not in self.numbers:
            return None
        before = self.seeds.index(episode.seed) * len(self.numbers) + self.numbers.index(episode.number)
        return before * len(self.parties) + self.parties.index(party)
