"""Is a start safe? All motions of a closed loop with uncertain parameters, enclosed."""
