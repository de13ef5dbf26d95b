"""Plan files of many requests offline, in parts that a run which was ended goes on from."""

from orientd.batch.requests import Requests, open_requests
from orientd.batch.run import Batch, Progress, Settings
