"""What people use around a simulation: command line, checks of the specs, module template, pictures of the graph."""
