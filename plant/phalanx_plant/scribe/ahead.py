"""What is worked out for many events at once, before each of them is told in its order.

A call costs more than what it works out for one event.
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

Question = TypeVar("Question")
Answer = TypeVar("Answer")

_AT_ONCE = 32
"""So many at most: more save little, and in real time the next sample is due soon."""


class Ahead(Generic[Question, Answer]):
    """Questions asked one by one, and answered in their order: several when one is due."""

    def __init__(self, answers: Callable[[list[Question]], Iterable[Answer]]) -> None:
        """answers: to some questions, in their order."""
        self._answer = answers
        self._asked: list[Question] = []
        self._answers: deque[Answer] = deque()

    def ask(self, question: Question) -> None:
        """Have this answered after all that was asked before."""
        self._asked.append(question)

    def next(self) -> Answer:
        """The answer to the oldest question."""
        if not self._answers:
            self._answers.extend(self._answer(self._asked[:_AT_ONCE]))
            del self._asked[:_AT_ONCE]
        return self._answers.popleft()
