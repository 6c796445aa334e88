"""Motions through impacts and contacts, hop after hop, and the multiplier of an orbit among them."""
