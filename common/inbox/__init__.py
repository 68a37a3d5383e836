"""What a service is given: one buffer per topic, freshness, subscriptions."""
