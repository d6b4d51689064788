"""What accuracy costs: errors of settings of the integration, and of simplified models, against their price."""
