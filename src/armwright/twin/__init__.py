"""The simulated arm as CiA 402 drives on a CAN bus, and the master that runs a scenario's controller over that bus."""
