"""One benchmark that runs any method on any data set."""
