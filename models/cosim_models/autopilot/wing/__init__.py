"""Flight of autopilots on wings, and on lifting rotors."""
