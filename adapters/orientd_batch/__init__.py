"""Plan files of many requests offline, in parts; an interrupted run can be resumed."""

from orientd_batch.batch import Batch
from orientd_batch.request_file import Requests, open_requests
