"""Trajectories of a batch: a file for each world, beside the tables.

options    where they go, and how
tracks     the fields of a simulator's frame that go into them, with units and meanings
contents   the contents of a world's file
splits     which worlds are for training, validation and test
writer     frames as they come, into the files of all worlds
moments    mean and deviation of moving fields, for training
catalog    the manifest of the folder
"""
