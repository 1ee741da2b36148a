"""All that crosses between soil, machines and the world."""
