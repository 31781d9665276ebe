"""What a robot can do where it stands: which poses it can take, what is seen there, and the way from one to the next."""
