"""`readygo learn`: a fleet that records and a trainer that learns from it, until a policy drives well."""
