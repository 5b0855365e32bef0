//! Steps and tests that ranks do together.

use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, ToSocketAddrs};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use burn::tensor::{Tensor, TensorData};

use super::link::Link;
use super::{Place, RanksError};
use crate::batch::Batch;
use crate::layers::parameter_count;
use crate::step::{SampleResult, StepResult, evaluate_parts, step, steps_of_parts};
use crate::upsampling::Upsampling;

/// First bytes of a rank that joins.
const HELLO: &[u8; 16] = b"graspmill rank 1";
/// Who connects says at once who he is.
const HELLO_WAIT: Duration = Duration::from_secs(10);
/// Bytes of a sample's result in a frame.
const RESULT_BYTES: usize = 24;

/// The ranks, as one of them sees them.
#[derive(Debug)]
pub struct Team {
    rank: usize,
    ranks: usize,
    /// At rank 0 all others, from rank 1 on; elsewhere rank 0.
    links: Vec<Link>,
    /// Whether the last exchange told that a rank was asked to stop.
    stopping: bool,
}

/// What ranks add up: a sum of gradients, none before the first part; results in the batch's order; who must stop.
#[derive(Default)]
struct Sum {
    gradient: Option<Vec<f32>>,
    results: Vec<SampleResult>,
    stop: bool,
}

impl Team {
    /// A process alone: every step is [`step`], nothing is sent.
    #[must_use]
    pub fn alone() -> Self {
        Self { rank: 0, ranks: 1, links: Vec::new(), stopping: false }
    }

    /// Joins the others, unless `stop` is set first. `task` says what this rank is about to do: it must be the same at
    /// all.
    ///
    /// # Errors
    /// [`RanksError`] if they do not all come in time, or do something else.
    pub fn join(place: &Place, task: &str, stop: &AtomicBool) -> Result<Self, RanksError> {
        let timeout = Duration::from_secs(place.timeout_s);
        let links = if place.rank == 0 {
            gather(place, task, timeout, stop)?
        } else {
            vec![enter(place, task, timeout, stop)?]
        };
        Ok(Self { rank: place.rank, ranks: place.ranks, links, stopping: false })
    }

    /// What rank 0 says, at every rank.
    ///
    /// # Errors
    /// [`RanksError::Lost`].
    pub fn tell(&mut self, bytes: Vec<u8>) -> Result<Vec<u8>, RanksError> {
        if self.rank > 0 {
            return receive(&mut self.links[0], 0);
        }
        for (link, rank) in self.links.iter_mut().zip(1..) {
            send(link, rank, &bytes)?;
        }
        Ok(bytes)
    }

    /// Whether it is time to stop. Alone, as soon as `stop` is set; in company when the last exchange told everyone, so
    /// that all stop after the same batch.
    #[must_use]
    pub fn must_stop(&self, stop: &AtomicBool) -> bool {
        if self.ranks == 1 { stop.load(Ordering::Relaxed) } else { self.stopping }
    }

    /// As [`step`], each rank with its share of the batch.
    ///
    /// # Errors
    /// [`RanksError::Lost`].
    pub fn step(
        &mut self,
        vector: &Tensor<1>,
        batch: &Batch,
        mode: Upsampling,
        stop: &AtomicBool,
    ) -> Result<StepResult, RanksError> {
        if self.ranks == 1 {
            return Ok(step(vector, batch, mode));
        }
        let own = steps_of_parts(vector, batch, &self.share(batch), mode);
        let own = own.into_iter().map(|part| (Some(floats(part.gradient)), part.samples)).collect();
        let sum = self.exchange(own, stop)?;
        let device = vector.device();
        let gradient = sum.gradient.map_or_else(
            || vector.zeros_like(),
            |values| Tensor::from_data(TensorData::new(values, vector.dims()), &device),
        );
        Ok(StepResult { gradient, samples: sum.results })
    }

    /// As [`crate::step::evaluate`], each rank with its share of the batch.
    ///
    /// # Errors
    /// [`RanksError::Lost`].
    pub fn evaluate(
        &mut self,
        vector: &Tensor<1>,
        batch: &Batch,
        mode: Upsampling,
        stop: &AtomicBool,
    ) -> Result<Vec<SampleResult>, RanksError> {
        let own = evaluate_parts(vector, batch, &self.share(batch), mode);
        if self.ranks == 1 {
            return Ok(own);
        }
        Ok(self.exchange(vec![(None, own)], stop)?.results)
    }

    /// This rank's parts of a batch: a run of them, as even as can be.
    fn share(&self, batch: &Batch) -> Vec<Range<usize>> {
        let mut parts = batch.parts();
        let at = |rank: usize| rank * parts.len() / self.ranks;
        let (start, end) = (at(self.rank), at(self.rank + 1));
        parts.drain(start..end).collect()
    }

    /// Adds up what every rank has, in the order of ranks and so of parts; everyone gets the whole.
    fn exchange(
        &mut self,
        own: Vec<(Option<Vec<f32>>, Vec<SampleResult>)>,
        stop: &AtomicBool,
    ) -> Result<Sum, RanksError> {
        let (rank, stop) = (self.rank, stop.load(Ordering::Relaxed));
        let mut sum = if rank == 0 { Sum::default() } else { self.receive_sum(0)? };
        for (gradient, results) in own {
            sum.add(gradient, results);
        }
        sum.stop |= stop;
        if rank > 0 {
            send(&mut self.links[0], 0, &sum.to_bytes())?;
            sum = self.receive_sum(0)?;
        } else {
            for other in 1..self.ranks {
                send(&mut self.links[other - 1], other, &sum.to_bytes())?;
                sum = self.receive_sum(other)?;
            }
            self.tell(sum.to_bytes())?;
        }
        self.stopping = sum.stop;
        Ok(sum)
    }

    fn receive_sum(&mut self, rank: usize) -> Result<Sum, RanksError> {
        let link = &mut self.links[rank.saturating_sub(1)];
        let lost = || std::io::Error::new(std::io::ErrorKind::InvalidData, "a frame that is no sum");
        Sum::from_bytes(&receive(link, rank)?).ok_or_else(|| RanksError::Lost { rank, source: lost() })
    }
}

/// Rank 0 waits for all others.
fn gather(place: &Place, task: &str, timeout: Duration, stop: &AtomicBool) -> Result<Vec<Link>, RanksError> {
    let deadline = Instant::now() + timeout;
    let listen = |source| RanksError::Listen { address: place.address.clone(), source };
    if place.ranks == 1 {
        return Ok(Vec::new());
    }
    let listener = TcpListener::bind(&listening(&place.address)[..]).map_err(listen)?;
    let mut links: Vec<Option<Link>> = (1..place.ranks).map(|_| None).collect();
    while links.iter().any(Option::is_none) {
        if stop.load(Ordering::Relaxed) {
            return Err(RanksError::Stopped);
        }
        if Instant::now() >= deadline {
            let missing = links.iter().filter(|link| link.is_none()).count();
            let (ranks, seconds, address) = (place.ranks, place.timeout_s, place.address.clone());
            return Err(RanksError::Absent { missing, ranks, seconds, address });
        }
        // Who gives up while being accepted is no reason to end.
        let Ok(Some(mut link)) = Link::accept(&listener, timeout.min(HELLO_WAIT)) else { continue };
        let Ok(bytes) = link.receive() else { continue }; // a stranger
        let Some((rank, ranks, its_task)) = hello(&bytes) else { continue };
        let why = if ranks != place.ranks {
            Some(format!("it is one of {ranks} ranks, not of {}", place.ranks))
        } else if its_task != task {
            Some("its version, configuration or dataset is another one than rank 0's".to_owned())
        } else if !(1..ranks).contains(&rank) || links[rank - 1].is_some() {
            Some("that rank is there already".to_owned())
        } else {
            None
        };
        let _ = link.send(why.as_deref().unwrap_or_default().as_bytes()); // rank 0 tells the same
        match why {
            Some(why) => return Err(RanksError::Unlike { rank, why }),
            None => {
                link.set_timeout(timeout).map_err(listen)?;
                links[rank - 1] = Some(link);
            }
        }
    }
    Ok(links.into_iter().flatten().collect())
}

/// Where rank 0 listens: on loopback only if it is told so by number or as `localhost`; else at the port of every
/// interface, for a machine's own name often stands for loopback in its `/etc/hosts`.
fn listening(address: &str) -> Vec<SocketAddr> {
    let port = address.rsplit_once(':').and_then(|(_, port)| port.parse::<u16>().ok());
    let is_loopback = |at: &SocketAddr| at.ip().is_loopback();
    let literal = address.parse::<SocketAddr>().is_ok_and(|at| is_loopback(&at)) || address.starts_with("localhost:");
    match port {
        Some(port) if !literal => vec![(Ipv6Addr::UNSPECIFIED, port).into(), (Ipv4Addr::UNSPECIFIED, port).into()],
        _ => address.to_socket_addrs().map(Iterator::collect).unwrap_or_default(),
    }
}

/// Another rank goes to rank 0.
fn enter(place: &Place, task: &str, timeout: Duration, stop: &AtomicBool) -> Result<Link, RanksError> {
    let deadline = Instant::now() + timeout;
    let mut link = loop {
        match Link::connect(&place.address, timeout) {
            Ok(link) => break link,
            Err(_) if stop.load(Ordering::Relaxed) => return Err(RanksError::Stopped),
            Err(source) if Instant::now() >= deadline => {
                let (address, seconds) = (place.address.clone(), place.timeout_s);
                return Err(RanksError::Unreached { address, seconds, source });
            }
            Err(_) => {} // rank 0 may not listen yet
        }
    };
    let numbers = [place.rank, place.ranks].map(|number| (number as u64).to_le_bytes());
    send(&mut link, 0, &[&HELLO[..], &numbers.concat(), task.as_bytes()].concat())?;
    let why = receive(&mut link, 0)?;
    if why.is_empty() {
        Ok(link)
    } else {
        Err(RanksError::Unlike { rank: place.rank, why: String::from_utf8_lossy(&why).into_owned() })
    }
}

/// Rank, number of ranks and task of who joins.
fn hello(bytes: &[u8]) -> Option<(usize, usize, &str)> {
    let (rank, rest) = bytes.strip_prefix(HELLO)?.split_first_chunk()?;
    let (ranks, task) = rest.split_first_chunk()?;
    Some((u64::from_le_bytes(*rank) as usize, u64::from_le_bytes(*ranks) as usize, str::from_utf8(task).ok()?))
}

fn send(link: &mut Link, rank: usize, bytes: &[u8]) -> Result<(), RanksError> {
    link.send(bytes).map_err(|source| RanksError::Lost { rank, source })
}

fn receive(link: &mut Link, rank: usize) -> Result<Vec<u8>, RanksError> {
    link.receive().map_err(|source| RanksError::Lost { rank, source })
}

fn floats(tensor: Tensor<1>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().collect()
}

impl Sum {
    fn add(&mut self, gradient: Option<Vec<f32>>, results: Vec<SampleResult>) {
        self.results.extend(results);
        self.gradient = match (self.gradient.take(), gradient) {
            (Some(mut sum), Some(more)) => {
                sum.iter_mut().zip(&more).for_each(|(sum, more)| *sum += more);
                Some(sum)
            }
            (sum, more) => sum.or(more),
        };
    }

    fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = vec![u8::from(self.stop), u8::from(self.gradient.is_some())];
        bytes.extend((self.results.len() as u64).to_le_bytes());
        for result in &self.results {
            let SampleResult { total, quality, rotation, width, quality_logit, label } = *result;
            bytes.extend([total, quality, rotation, width, quality_logit].map(f32::to_le_bytes).concat());
            bytes.extend([label, 0, 0, 0]);
        }
        bytes.extend(self.gradient.iter().flatten().flat_map(|value| value.to_le_bytes()));
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let ([stop, has_gradient], rest) = bytes.split_first_chunk()?;
        let (count, rest) = rest.split_first_chunk()?;
        let len = usize::try_from(u64::from_le_bytes(*count)).ok()?.checked_mul(RESULT_BYTES)?;
        let (results, gradient) = rest.split_at_checked(len)?;
        let numbers = |bytes: &[u8]| -> Vec<f32> {
            bytes.as_chunks::<4>().0.iter().map(|value| f32::from_le_bytes(*value)).collect()
        };
        let result = |bytes: &[u8; RESULT_BYTES]| {
            let values = numbers(&bytes[..20]);
            SampleResult {
                total: values[0],
                quality: values[1],
                rotation: values[2],
                width: values[3],
                quality_logit: values[4],
                label: bytes[20],
            }
        };
        if gradient.len() != usize::from(*has_gradient) * 4 * parameter_count() {
            return None;
        }
        Some(Self {
            gradient: (*has_gradient == 1).then(|| numbers(gradient)),
            results: results.as_chunks().0.iter().map(result).collect(),
            stop: *stop == 1,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn result(number: usize) -> SampleResult {
        let value = number as f32 + 0.5;
        SampleResult {
            total: value,
            quality: -value,
            rotation: 0.1 * value,
            width: f32::MIN_POSITIVE,
            quality_logit: 3.0 * value,
            label: (number % 2) as u8,
        }
    }

    /// Numbers whose sum depends on the order, three parts at most a rank.
    fn parts(rank: usize) -> Vec<(Option<Vec<f32>>, Vec<SampleResult>)> {
        let part = |part: usize| {
            let number = 3 * rank + part;
            let scale = [1.0, 1e8, -1e8][number % 3];
            let gradient = (0..parameter_count()).map(|at| scale * (1.0 + at as f32 / 7.0)).collect();
            (Some(gradient), vec![result(number); number % 3])
        };
        (0..[3, 0, 2][rank]).map(part).collect()
    }

    #[test]
    fn an_exchange_adds_in_the_order_of_parts_and_tells_who_stops() {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut expected = Sum::default();
        for (gradient, results) in (0..3).flat_map(parts) {
            expected.add(gradient, results);
        }
        let threads: Vec<_> = (0..3)
            .map(|rank| {
                std::thread::spawn(move || {
                    let place = Place { rank, ranks: 3, address: format!("127.0.0.1:{port}"), timeout_s: 60 };
                    let mut team = Team::join(&place, "test", &AtomicBool::new(false)).unwrap();
                    assert_eq!(team.tell(vec![rank as u8; 3]).unwrap(), [0; 3]);
                    let sum = team.exchange(parts(rank), &AtomicBool::new(false)).unwrap();
                    assert!(!team.must_stop(&AtomicBool::new(true)), "not before all know");
                    let (began, times) = (Instant::now(), 20);
                    for _ in 0..times {
                        team.exchange(parts(rank), &AtomicBool::new(rank == 1)).unwrap();
                    }
                    assert!(team.must_stop(&AtomicBool::new(false)));
                    if rank == 0 {
                        println!("an exchange of three ranks: {:?}", began.elapsed() / times);
                    }
                    (sum.gradient, sum.results)
                })
            })
            .collect();
        for thread in threads {
            let (gradient, results) = thread.join().unwrap();
            assert!(gradient == expected.gradient);
            assert_eq!(results, expected.results);
        }
    }

    #[test]
    fn frames_that_are_no_sums_are_refused() {
        let sum = Sum { gradient: Some(vec![1.5; parameter_count()]), results: vec![result(3); 2], stop: true };
        let bytes = sum.to_bytes();
        let back = Sum::from_bytes(&bytes).unwrap();
        assert!(back.gradient == sum.gradient && back.results == sum.results && back.stop);
        for len in [0, 1, 9, 10, 57, bytes.len() - 1] {
            assert!(Sum::from_bytes(&bytes[..len]).is_none(), "{len}");
        }
        let mut endless = bytes;
        endless[2..10].fill(0xFF);
        assert!(Sum::from_bytes(&endless).is_none());
        assert_eq!(hello(b"GET / HTTP/1.1\r\n\r\n"), None);
    }

    /// Why this module is here (`docs/data-parallel.md`). When it fails, Burn's own may do.
    #[test]
    #[should_panic(expected = "Distributed operations are not supported")]
    fn burns_all_reduce_does_not_know_the_host() {
        use burn::tensor::Device;
        use burn::tensor::distributed::{ReduceOperation, all_reduce};
        let device = Device::flex();
        let vector = Tensor::<1>::from_data([1.0_f32, 2.0], &device);
        let _ = all_reduce(vector, ReduceOperation::Sum, vec![device]).resolve();
    }
}
