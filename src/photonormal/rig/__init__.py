"""From the photographs of a rig to what is known of it, on disk: read -> find -> write."""
