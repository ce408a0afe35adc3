"""The tables of a run's ledger."""

import sqlite3
from pathlib import Path

_SCHEMA = """
CREATE TABLE IF NOT EXISTS episode (
    idx INTEGER PRIMARY KEY,
    stage TEXT NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('waiting', 'leased', 'granted', 'committed', 'rejected')),
    attempt INTEGER NOT NULL DEFAULT 0,
    failures INTEGER NOT NULL DEFAULT 0,
    worker TEXT NOT NULL DEFAULT '',
    deadline_s REAL NOT NULL DEFAULT 0,
    recorder TEXT NOT NULL DEFAULT '',
    reason TEXT NOT NULL DEFAULT '',
    shard TEXT NOT NULL DEFAULT '',
    samples INTEGER NOT NULL DEFAULT 0,
    policy TEXT NOT NULL DEFAULT '',  -- leased with the present attempt
    driven_by TEXT NOT NULL DEFAULT '',  -- the policy that drove the durable attempt
    assigned TEXT,  -- the policy that shall drive even if a newer one exists
    deaths INTEGER NOT NULL DEFAULT 0,  -- workers that ended while they held the episode at its present stage
    role TEXT NOT NULL DEFAULT '',  -- with `session` and `worker` the process that holds it: `protocol.Holder`
    session TEXT NOT NULL DEFAULT ''
);
CREATE INDEX IF NOT EXISTS by_state ON episode (state, stage, idx);
CREATE INDEX IF NOT EXISTS by_reason ON episode (reason) WHERE reason != '';
CREATE TABLE IF NOT EXISTS result (
    idx INTEGER NOT NULL,
    stage TEXT NOT NULL,
    sha256 TEXT NOT NULL,
    PRIMARY KEY (idx, stage)
);
CREATE TABLE IF NOT EXISTS counter (name TEXT PRIMARY KEY, value REAL NOT NULL);
CREATE TABLE IF NOT EXISTS run (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS policy (
    version INTEGER PRIMARY KEY,
    sha256 TEXT NOT NULL UNIQUE,
    files TEXT NOT NULL,
    samples INTEGER NOT NULL,
    wall_ns INTEGER NOT NULL
);
"""
_DURABLE = """
CREATE TABLE IF NOT EXISTS durable (one INTEGER PRIMARY KEY, episodes INTEGER NOT NULL, samples INTEGER NOT NULL);
INSERT OR IGNORE INTO durable
    SELECT 1, count(*), coalesce(sum(samples), 0) FROM episode WHERE state = 'committed';
CREATE TRIGGER IF NOT EXISTS durable_changed AFTER UPDATE OF state, samples ON episode
WHEN old.state = 'committed' OR new.state = 'committed' BEGIN
    UPDATE durable SET
        episodes = episodes + (new.state = 'committed') - (old.state = 'committed'),
        samples = samples + new.samples * (new.state = 'committed') - old.samples * (old.state = 'committed');
END;
CREATE TRIGGER IF NOT EXISTS durable_added AFTER INSERT ON episode WHEN new.state = 'committed' BEGIN
    UPDATE durable SET episodes = episodes + 1, samples = samples + new.samples;
END;
CREATE TRIGGER IF NOT EXISTS durable_forgotten AFTER DELETE ON episode WHEN old.state = 'committed' BEGIN
    UPDATE durable SET episodes = episodes - 1, samples = samples - old.samples;
END;
"""
"""How many episodes are durable, kept by the database itself: every claim asks, and to count them takes ever longer."""
LAYOUT = 1
"""Number of this layout; ledgers of another one are refused, and so rebuilt from the shards."""


def open_database(path: Path) -> sqlite3.Connection:
    """Open a ledger's file, or make it; usable from several threads that take turns.

    Raises:
        sqlite3.Error: If it is no ledger of this layout, or cannot be written.
    """
    database = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    database.execute("PRAGMA journal_mode = WAL")
    # NORMAL loses at most the latest leases in a power cut; grants are confirmed again by the recorder's own files.
    database.execute("PRAGMA synchronous = NORMAL")
    (layout,) = database.execute("PRAGMA user_version").fetchone()
    if layout != LAYOUT and database.execute("SELECT 1 FROM sqlite_master").fetchone():
        database.close()
        raise sqlite3.DatabaseError(f"its layout is number {layout}, this version of readygo reads {LAYOUT}")
    database.executescript(f"{_SCHEMA} {_DURABLE} PRAGMA user_version = {LAYOUT};")
    return database
