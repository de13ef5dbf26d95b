"""Plan files of many requests offline, in parts; an interrupted run can be resumed."""
