"""What is worked out for many events at once."""

from phalanx_plant.scribe.ahead import Ahead


def test_answers_come_in_the_order_of_their_questions_and_few_at_once_however_many_wait():
    """In real time the next sample may be due before hundreds of answers are there."""
    sizes = list[int]()

    def squares(asked: list[int]) -> list[int]:
        sizes.append(len(asked))
        return [n * n for n in asked]

    ahead = Ahead(squares)
    for n in range(100):
        ahead.ask(n)
    found = [ahead.next() for _ in range(50)]
    ahead.ask(100)
    found += [ahead.next() for _ in range(51)]
    assert found == [n * n for n in range(101)]
    assert 1 < max(sizes) < 50
