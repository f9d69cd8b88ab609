"""Work on the machines of a Ray cluster.

`backend` gives joblib a backend whose work a process of its own (`driver`) hands to the cluster;
`sameness` tells whether two machines compute the same.
"""
