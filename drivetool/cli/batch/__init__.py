"""drivetool batch: the recipe of a site, done with every recording, on the cores or the cluster there is."""
