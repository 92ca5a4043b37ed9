"""Logs on standard error: lines for people, or JSON lines as evac's own stages write them."""

import json
import logging
import sys
from datetime import datetime, timezone


class _Json(logging.Formatter):
    def format(self, record):
        stamp = datetime.fromtimestamp(record.created, timezone.utc).isoformat(timespec="microseconds")
        return json.dumps({"timestamp": stamp.replace("+00:00", "Z"), "level": record.levelname,
                           "fields": {"message": record.getMessage()}, "target": record.name})


def start_logging(level, form):
    """The stage's log; `level` and `form` as on the command line."""
    logging.addLevelName(logging.WARNING, "WARN")
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Json() if form == "json" else logging.Formatter("%(asctime)s %(levelname)5s %(message)s"))
    log = logging.getLogger("evac_stage")
    log.addHandler(handler)
    log.setLevel({"error": 40, "warn": 30, "info": 20}.get(level, 10))
    return log
