"""Many runs by other processes, on this machine or on others: jobs go out in chunks, answers come as they are ready."""
