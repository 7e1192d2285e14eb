"""Finished experiments whose figures the method pages quote; runnable, not developed further."""
