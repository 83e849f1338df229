"""Contacts of feet with the ground: finding them, and how much the feet slide in them."""
