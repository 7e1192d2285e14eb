"""Finished experiments whose figures the method pages quote; runnable but frozen."""
