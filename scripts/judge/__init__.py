"""An experiment's grasps, executed again in PyBullet. The contract, the gate and the engine are the cross-check's."""
