"""Plan files of many requests offline, in parts that an interrupted run goes on from."""

from orientd.batch.batch import Batch
from orientd.batch.request_file import Requests, open_requests
