"""report.html: one file with charts that answer to the mouse, a pure function of documents."""
