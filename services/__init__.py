"""The independent services. They talk only over topics and never import each other."""
