//! The two model-predictive controllers, their limits, fall-backs and the guard behind them.
