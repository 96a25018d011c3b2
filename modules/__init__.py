"""Flight software: one folder per module, grouped by domain; it never imports the simulation."""
