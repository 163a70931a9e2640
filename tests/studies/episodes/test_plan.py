"""Which episodes there are: as a list would say it."""

from slrl_sumo.metrics.outcomes import TypeOutcome
from slrl_sumo.studies.episodes.episode import Episode
from slrl_sumo.studies.episodes.plan import EpisodePlan
from slrl_sumo.studies.episodes.tables import EpisodeTables

PLAN = EpisodePlan((("prior", 4), ("sumo", 0), ("prior", 9)), range(3, 5), range(7, 10))


def test_the_index_of_each_episode_is_its_place() -> None:
    episodes = list(PLAN)
    assert len(set(episodes)) == len(episodes) == len(PLAN) == 18
    assert [PLAN.index(episode) for episode in episodes] == list(range(18))
    assert episodes[0] == Episode("prior", 4, 3, 7)
    assert {episode.seed for episode in episodes[:9]} == {3}


def test_what_is_not_planned_has_no_place() -> None:
    for other in (("prior", 5, 3, 7), ("greedy", 4, 3, 7), ("prior", 4, 5, 7), ("prior", 4, 3, 6), ("prior", 4, 3, 10)):
        assert PLAN.index(Episode(*other)) is None


def test_tables_remember_unfinished_seeds_only() -> None:
    tables = EpisodeTables(PLAN.parties, 10, len(PLAN.numbers))
    still = TypeOutcome("car", (10,), (10,), 1, 0.0, 0.0, 10, 0, 0, 0, 0)
    held = []
    for number, episode in enumerate(PLAN):
        if number == 4:
            tables.leave_out(episode)
        else:
            tables.add(episode, (still,))
        held.append(len(tables._seeds))
    assert max(held) == 3
    assert held[8] == held[17] == 0
    assert [row["episodes"] for row in tables.rows()] == [6, 5, 6]
