"""From the description of a scenario to what computes: files read, parameters, arrays, parts."""
