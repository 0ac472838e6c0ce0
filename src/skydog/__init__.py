"""Aerial shepherding: one drone, flown like a sheepdog, herds a swarm of ground robots."""
