"""What can be asked: identify, predict, recover, screen, box. Each reads like its page."""
