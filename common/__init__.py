"""The domain library of readygo: what more than one service needs, one concept per subpackage."""
