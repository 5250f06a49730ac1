"""Rolling contact of two rigid bodies: surfaces and Montana's kinematics, section 2.2 of the paper."""
