"""`readygo learn`: a fleet records episodes and a trainer learns from them, until a policy drives well."""
