"""A limit is one of a time, not of a lifetime."""

from viewer.server.rate_limit import RateLimit


def test_messages_at_the_rate_are_always_allowed_and_more_are_not() -> None:
    now = 0.0
    limit = RateLimit(2.0, 3.0, lambda: now)
    assert [limit.allow() for _ in range(4)] == [True, True, True, False]
    for _ in range(100):
        now += 0.5
        assert limit.allow()
    assert not limit.allow()
