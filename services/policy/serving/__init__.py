"""Parts of the service that runs a policy; none needs torch."""
