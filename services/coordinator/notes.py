"""Notes about a run as a whole: values under keys, and counters."""

from readygo.services.coordinator.database import Database

_TURN = "turn"


class Notes:
    """The tables `run` and `counter` of a ledger."""

    def __init__(self, database: Database) -> None:
        """Read and write these tables of a database."""
        self._database = database

    def __contains__(self, key: str) -> bool:
        return self._database.has_row("SELECT 1 FROM run WHERE key = ?", key)

    def get(self, key: str) -> str:
        """What is noted under a key, empty if nothing is."""
        row = self._database.one("SELECT value FROM run WHERE key = ?", key)
        return str(row[0]) if row else ""

    def put(self, key: str, value: str = "") -> None:
        """Store a value under a key; it replaces an earlier one."""
        self._database.run("INSERT OR REPLACE INTO run VALUES (?, ?)", key, value)

    def drop(self, key: str) -> None:
        """Forget what is noted under a key."""
        self._database.run("DELETE FROM run WHERE key = ?", key)

    def agree(self, key: str, value: str) -> str:
        """The run's value for `key`, which is the first one that was proposed."""
        with self._database.together():
            self._database.run("INSERT OR IGNORE INTO run VALUES (?, ?)", key, value)
            return self.get(key)

    def keys(self, prefix: str) -> set[str]:
        """What follows `prefix` in the keys that begin with it."""
        rows = self._database.all("SELECT key FROM run WHERE key LIKE ?", f"{prefix}%")
        return {key.removeprefix(prefix) for (key,) in rows}

    def next_turn(self, least: int) -> int:
        """The number of those who have led the run one after the other, higher than all before and at least `least`."""
        with self._database.together():
            turn = max(least, int(self.get(_TURN) or 0) + 1)
            self.put(_TURN, str(turn))
        return turn

    def add(self, counter: str, amount: float) -> None:
        """Add to a counter."""
        self._database.run(
            "INSERT INTO counter VALUES (?, ?) ON CONFLICT (name) DO UPDATE SET value = value + excluded.value",
            counter,
            amount,
        )

    def counters(self) -> dict[str, float]:
        """All counters."""
        return dict(self._database.all("SELECT name, value FROM counter"))
