"""A laboratory that is not there: the twin's bodies behind real sockets, topics and packets."""
